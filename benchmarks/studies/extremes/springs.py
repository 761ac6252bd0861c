r"""Step-size resonances of the Fermi-Pasta-Ulam problem with two stiff springs, over (h omega_1, h omega_2).

Resonant strips are narrow: the angles of the grid are multiples of pi / N, so that lines of low order
:math:`|k_1| + |k_2|` pass exactly through its nodes.  (With n = 0 springs exchange energy in the problem itself.)  The
energy that the step keeps has for a spring the part :math:`J\theta/h`, J its action: the area of the ellipse that M
keeps, over 2 pi.  Means over `WINDOWS` parts of a run remove oscillation.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), XIII.2 (h = 0.02 there) and XIII.9; M.
Mandziuk, T. Schlick, Chem. Phys. Lett. 237 (1995) 525-535 (h omega = sqrt 2 and sqrt 3 of Stormer-Verlet).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import sympy as sp

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study, over
from phasebench.benchmarks.page.verdict import at_least
from phasebench.benchmarks.problems.fpu import formula, soft_springs
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.families.trigonometric import with_filters
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.hamiltonian import Hamiltonian

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

TABLE = "extremes_springs"
H, WINDOWS = 0.02, 8
#: The largest h omega, the smallest angle in grid units, the points from which theta(h omega) is interpolated.
LAST, LEAST, POINTS = 6.2, 4, 2400
#: Method -> (grid intervals in an angle of pi, steps of a run)
RUNS = {
    "stormer-verlet": (48, 3000),
    "blanes-moan-s6": (48, 3000),
    "deuflhard": (36, 3000),
    "mollified-impulse": (36, 3000),
    "scheme-i": (36, 1600),
    "gauss-2": (36, 800),
}
#: Positions and momenta of the soft springs; each stiff one begins with the energy 1.
SOFT_Q, SOFT_P = (1.0, 0.3), (1.0, -0.2)
#: Largest order |k1| + |k2| of a line, and of those in the figure; the distance, in grid units, within which a node is
#: on a line; a crest is not below its neighbours on both sides and at least `HIGH` times the nodes beyond them.
ORDER, DRAWN, NEAR, HIGH = 4, 3, 0.75, 5.0
#: Wanted share of a method's crests on lines, and its wanted ratio to the share of all nodes.
MOST, TIMES = 0.9, 1.5
#: Larger drifts are cut to this; nodes of each method in the table of the HTML page.
TOP, SHOWN = 10.0, 200


# -- runs --------------------------------------------------------------------------------------------------------------


class Turns:
    """A method's step on a spring as a rotation of (omega q, p): its matrices and angles at z = h omega, if stable."""

    def __init__(self, id: str, z: Sequence[float] | np.ndarray) -> None:
        chosen = integrator(id)
        found = [oscillator.matrix(chosen, float(x)) for x in z]
        stable = [abs(np.trace(M)) < 2 + oscillator.SAME for M in found]
        end = stable.index(False) if False in stable else len(stable)
        self.z, self.matrices = np.asarray(z)[:end], found[:end]
        angles = [np.arctan2(_sine(M), np.trace(M) / 2) for M in self.matrices]
        self.angles = np.unwrap(np.array(angles) % (2 * np.pi))

    def energy(self, k: int, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """The energy J theta / h, which the step keeps, of a spring with the k-th h omega, at x = omega q and p."""
        M, s = self.matrices[k], _sine(self.matrices[k])
        if abs(s) < 1e-6:  # a rotation by pi: every ellipse is kept
            action = (p**2 + x**2) / 2
        else:
            action = (M[0, 1] * p**2 + (M[0, 0] - M[1, 1]) * x * p - M[1, 0] * x**2) / (2 * s)
        return action * self.angles[k] / self.z[k]


def _sine(M: np.ndarray) -> float:
    return float(np.sqrt(max(0.0, 1 - (np.trace(M) / 2) ** 2)) * np.sign(M[0, 1] - M[1, 0]))


def grid(id: str, nodes: int) -> np.ndarray:
    """The stable values of h omega up to `LAST` at which a step turns by a multiple of pi / ``nodes``."""
    curve = Turns(id, np.linspace(LAST / POINTS, LAST, POINTS))
    angles = np.arange(LEAST, int(curve.angles[-1] / np.pi * nodes) + 1) * np.pi / nodes
    return np.interp(angles, curve.angles, curve.z)


class Springs:
    """Runs of a method on the Fermi-Pasta-Ulam problem for any two stiff frequencies, compiled only once.

    A trigonometric method is given the frequencies as data.  For all others they are two extra coordinates that do not
    move, so that the compiled functions do not depend on them.
    """

    def __init__(self, id: str) -> None:
        q, p, H_ = formula(1.0, 2)
        w = sp.symbols("w1 w2", real=True)
        self.method = BY_ID[id]
        self.told = self.method.family == "trigonometric"
        if self.told:
            self.system = Hamiltonian(q=q, p=p, H=H_, frequencies=[0, 0, 1, 1])
        else:
            stiff = sum((v**2 - 1) * x**2 / 2 for v, x in zip(w, q[2:], strict=True))
            still = sp.symbols("v1 v2", real=True)
            self.system = Hamiltonian(q=[*q, *w], p=[*p, *still], H=H_ + sp.expand_mul(stiff))
        self.prepared = prepare(self.method, self.system)

    def __call__(self, w: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """The states (q, p), arrays (4, steps + 1), with the stiff frequencies w; NaN from a step on that fails."""
        q, p, prepared = [*SOFT_Q, *(1 / w)], [*SOFT_P, 1.0, 1.0], self.prepared
        if self.told:
            frequencies = (sp.S.Zero, sp.S.Zero, *(sp.Rational(float(x)) for x in w))
            prepared = replace(prepared, begin=partial(with_filters, frequencies, self.method.data, DOUBLE))
        else:
            q, p = [*q, *w], [*p, 0.0, 0.0]
        Q, P = (np.full((steps + 1, self.system.d), np.nan) for _ in "qp")
        Q[0], P[0] = q, p
        layout = lay_out(prepared, self.system.d, H, q, p)
        with np.errstate(all="ignore"):
            layout(Q[1:], P[1:], np.full((steps, 1), np.nan), 1)
        return Q.T[:4].copy(), P.T[:4].copy()


def drift(Q: np.ndarray, P: np.ndarray, fast: np.ndarray) -> float:
    """The largest change of the mean energy over `WINDOWS` parts of a run, from the first, relative to that at first.

    Infinite if it is not finite; Q, P are the states (4, n), ``fast`` (n,) the energy of the stiff springs.
    """
    with np.errstate(all="ignore"):
        squares = [s * s for s in soft_springs(Q[:2], Q[2:])]
        energy = sum(s * s for s in squares) / 4 + (P[0] ** 2 + P[1] ** 2) / 2 + fast
        size = len(energy) // WINDOWS
        means = energy[: size * WINDOWS].reshape(WINDOWS, size).mean(axis=1)
        change = float(np.abs(means - means[0]).max() / energy[0])
    return change if np.isfinite(change) else np.inf


def drifts(method: str) -> list[dict]:
    """The drift of the energy: a row for each pair of the grid's frequencies."""
    nodes, steps = RUNS[method]
    run, turns, rows = Springs(method), Turns(method, grid(method, nodes)), []
    for i in range(len(turns.z)):
        for j in range(i, len(turns.z)):
            w = turns.z[[i, j]] / H
            Q, P = run(w, steps)
            with np.errstate(all="ignore"):
                fast = turns.energy(i, w[0] * Q[2], P[2]) + turns.energy(j, w[1] * Q[3], P[3])
            row = {"h omega 1": float(turns.z[i]), "h omega 2": float(turns.z[j])}
            row |= {"node 1": LEAST + i, "node 2": LEAST + j, "nodes": nodes, "steps": steps}
            rows.append(row | {"drift": drift(Q, P, fast)})
    return rows


# -- judging -----------------------------------------------------------------------------------------------------------


def lines(order: int, last: float) -> list[tuple[int, int, int]]:
    """(k1, k2, n) of the resonance lines k1 x + k2 y = 2 n, n != 0, that meet the square 0 < x, y <= ``last``.

    x and y are the rotation angles of the two springs in units of pi; |k1| + |k2| is at most ``order``.
    """
    found = []
    for k1 in range(order + 1):
        for k2 in range(-order, order + 1):
            if 0 < k1 + abs(k2) <= order and (k1 or k2 > 0):
                ends = [k1 * x + k2 * y for x in (0, last) for y in (0, last)]
                found += [(k1, k2, n) for n in range(-order, 2 * order) if n and min(ends) < 2 * n <= max(ends)]
    return found


def distance(x: ArrayLike, y: ArrayLike, order: int = ORDER) -> np.ndarray:
    """The distance of points (x, y), angles in units of pi, from the nearest resonance line; an array as x."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    all_ = [np.abs(a * x + b * y - 2 * n) / np.hypot(a, b) for a, b, n in lines(order, max(x.max(), y.max()) + 0.1)]
    return np.min(all_, axis=0) if all_ else np.full(x.shape, np.inf)


def square(rows: pd.DataFrame) -> pd.DataFrame:
    """A method's drift by the nodes of both rotation angles, symmetric in the two springs."""
    cut = rows.assign(drift=rows["drift"].clip(upper=TOP))
    half = cut.pivot_table(index="node 1", columns="node 2", values="drift")
    nodes = half.index.union(half.columns)
    half = half.reindex(index=nodes, columns=nodes)
    return half.fillna(half.T)


def crests(drift: np.ndarray) -> np.ndarray:
    """The local maxima of ``drift`` (n, n) along a row, a column or a diagonal: a boolean array.

    There the drift is no less than at both neighbours, and at least `HIGH` times that at the nodes beyond them.
    """
    n = len(drift)
    wide = np.pad(drift, 2, constant_values=np.inf)  # nodes at the border are no crests

    def beside(a: int, b: int) -> np.ndarray:
        return np.maximum(*(wide[2 + s * a : 2 + s * a + n, 2 + s * b : 2 + s * b + n] for s in (1, -1)))

    out = np.zeros(drift.shape, bool)
    for a, b in ((1, 0), (0, 1), (1, 1), (1, -1)):
        out |= (drift >= beside(a, b)) & (drift >= HIGH * beside(2 * a, 2 * b))
    return out


@of(TABLE)
def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """How many nodes and crests of each method's drift lie on resonance lines, and its highest crest."""
    out = []
    for method, part in rows.groupby("method", sort=False):
        known, nodes = square(part), part["nodes"].iloc[0]
        drift, angle = known.to_numpy(), known.index / nodes
        x, y = np.meshgrid(angle, angle, indexing="ij")
        upper = x <= y
        on, crest = (distance(x, y) <= NEAR / nodes)[upper], crests(drift)[upper]
        best = int(np.argmax(np.where(crest, drift[upper], -1)))
        row = {"method": method, "nodes": int(upper.sum()), "on lines": float(on.mean()), "crests": int(crest.sum())}
        row |= {"crests on lines": int(on[crest].sum()), "median drift": float(np.median(drift[upper]))}
        row |= {"highest crest": float(drift[upper][best]) if crest.any() else np.nan}
        z = dict(zip(part["node 2"], part["h omega 2"], strict=True))
        where = [z.get(round(c[upper][best] * nodes), np.nan) for c in (x, y)]
        out.append(row | {"at": f"({where[0]:.3g}, {where[1]:.3g})" if crest.any() else ""})
    return pd.DataFrame(out)


# -- what is shown -----------------------------------------------------------------------------------------------------


@picture(
    TABLE, "extremes-springs", "two stiff springs",
    "FPU with two stiff springs: the drift of the energy that a step keeps between resonances, the darker the "
    "larger (each method on a scale of its own); below the diagonal the resonance lines of theory, red of order "
    f"{DRAWN}, blue of lower order.",
)  # fmt: skip
def _draw(table: pd.DataFrame) -> style.Figure:
    figure, by_method = style.grid(table["method"].unique(), 3, 4.9, "h ω₁", "h ω₂")
    for id, axes in by_method.items():
        rows = table[table["method"] == id]
        last = rows.drop_duplicates("node 2").sort_values("node 2")
        z, angle = last["h omega 2"].to_numpy(), (last["node 2"] / last["nodes"]).to_numpy()
        drift = np.log10(square(rows).to_numpy())
        axes.set(title=id, aspect="equal")
        if len(z) != len(drift):  # rows are missing: there is no map
            continue
        span = {"vmin": np.nanquantile(drift, 0.3), "vmax": np.nanmax(drift)}
        axes.pcolormesh(z, z, drift, cmap="Greys", shading="nearest", **span)
        _lines(axes, z, angle)
        axes.set(xlim=(z[0], z[-1]), ylim=(z[0], z[-1]))
    return figure


def _lines(axes: Axes, z: np.ndarray, angle: np.ndarray) -> None:
    """Draw the resonance lines below the diagonal; z (h omega) and angle (in pi), arrays (n,), are of the nodes."""
    fine = np.linspace(angle[0], angle[-1], 400)
    for k1, k2, n in lines(DRAWN, angle[-1]):
        x, y = (fine, (2 * n - k1 * fine) / k2) if k2 else (np.full(len(fine), 2 * n / k1), fine)
        shown = (y <= x) & (y >= angle[0]) & (x <= angle[-1])
        x, y = (np.interp(v[shown], angle, z) for v in (x, y))
        colour = style.VERMILION if abs(k1) + abs(k2) == DRAWN else style.BLUE
        axes.plot(x, y, color=colour, linewidth=0.7, linestyle=(0, (4, 3)))


@of(summary)
def _table(found: pd.DataFrame) -> Table:
    caption = (
        f"Nodes of the grid and the share of them on lines; crests, at least {HIGH:g} times as high as two nodes "
        "aside; the median drift, and the highest crest with its (h ω₁, h ω₂), of the energy "
        f"({TOP:g}: as much, or more)."
    )
    highest = found["highest crest"].map(lambda x: number(x, 2))
    return Table(
        found.assign(**{"on lines": found["on lines"].map("{:.0%}".format), "highest crest": highest}), caption
    )


@of(TABLE)
def _whole(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.sort_values("drift", ascending=False).groupby("method", sort=False).head(SHOWN)


STUDY = Study(
    id="extremes-springs",
    place=220,
    question="Do step-size resonances lie where theory has them?",
    answer="On a chain with two stiff springs {on} of {crests} crests of the energy drift lie on resonance lines of "
    f"order ≤ {ORDER}; of all steps {{low}}% to {{high}}% do.",
    setting=(
        "[FPU](problems.md) with two stiff springs of frequencies ω₁ and ω₂, each with the energy 1 at first: "
        f"H = |p|² / 2 + (ω₁² q₁₁² + ω₂² q₁₂²) / 2 + quartic soft springs, h = {H:g}.",
        "On a spring alone a step turns by θ(h ω), 2 cos θ = tr M. On the lines k₁ θ₁ + k₂ θ₂ = 2πn, n ≠ 0, of order "
        f"|k₁| + |k₂| ≤ {ORDER} errors add up from step to step.",
        f"Grid: θ at multiples of π / N, N = {' or '.join(map(str, sorted({n for n, _ in RUNS.values()})))}, which "
        f"lines of low order meet exactly; h ω up to {LAST:g} or the stability limit.",
        f"Drift: the largest change of the mean energy over {WINDOWS} windows, with J θ / h for the springs, J the "
        "action that M keeps; the problem's own exchange (n = 0) keeps it.",
        f"A crest is at least {HIGH:g} times as high as the nodes two aside, along a row, a column or a diagonal; it "
        f"is on a line within {NEAR:g} of a node.",
    ),
    runs=(Runs(TABLE, drifts, over(method=tuple(RUNS)), needs=lambda method: (BY_ID[method], ProblemKey("fpu"))),),
    claims={
        "lines": Claim(
            "The crests of the energy drift lie on the resonance lines of theory",
            summary, "`crests on lines` / crests", at_least(MOST), "crests > 0", "of a method's crests", span=True,
        ),
        "chance": Claim(
            "Crests of the energy drift lie on resonance lines more often than by chance",
            summary, "`crests on lines` / crests / `on lines`", at_least(TIMES), "crests > 0", "times as often",
            span=True,
        ),
    },
    numbers={
        "on": Number(summary, "`crests on lines`", "crests > 0", pd.Series.sum),
        "crests": Number(summary, "crests", "crests > 0", pd.Series.sum),
        "low": Number(summary, "100 * `on lines`", "crests > 0", pd.Series.min, digits=2),
        "high": Number(summary, "100 * `on lines`", "crests > 0", digits=2),
    },
    figure=_draw,
    shown=_table,
    whole=_whole,
    limits=(
        "Nodes are on lines of low order exactly: a narrow resonance of a higher order that meets no node is not seen.",
        "The slow motion shifts and splits a resonance by h times its frequency, here less than a node.",
        "A method without a crest shows no resonance over so many steps, and is not judged.",
        "What a crest is, and how near a line it must lie, were chosen on an earlier run of these maps: therefore "
        "nodes by chance are counted too.",
        "Where the drift of a method is large everywhere, as for order 1, weak resonances drown in it.",
    ),
    within="extremes",
    listed=False,
)  # fmt: skip
