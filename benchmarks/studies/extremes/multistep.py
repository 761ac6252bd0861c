r"""Step-size resonances of symmetric multistep methods on Kepler's orbit, over the number N of steps an orbit.

Errors :math:`\delta` of the recursion :math:`\sum_j\alpha_j q_{n+j} = h^2\sum_j\beta_j f(q_{n+j})` move by

.. math:: \sum_j \alpha_j\,\delta_{n+j} = h^2\sum_j\beta_j\,f'(q_{n+j})\,\delta_{n+j}.

On the circle :math:`q_n = a e^{in\varphi}`, with complex numbers for points, that has constant coefficients in the
turning frame, and the errors grow like the roots of the polynomial that the page states, with :math:`K = h^2/a^3`.  On
an ellipse they grow like the eigenvalues of the product of all steps of two orbits (Floquet), q being the exact orbit.
At a resonance an orbit lasts a whole number of periods of a parasitic root of rho: errors grow, but only linearly in
time.  The polynomial and the product of steps are derived here.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import Count
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE, Multistep, stable_intervals, stormer
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import DRIFT, Method
from phasebench.integrators.registry import BY_ID

if TYPE_CHECKING:
    from phasebench.integrators.solution import Solution

TABLE, DRIFTS = "extremes_multistep", "extremes_multistep_drift"
METHODS = tuple(f"quinlan-tremaine-{order}" for order in QUINLAN_TREMAINE)
ECCENTRICITIES = (0.0, 0.2)
#: Runs: their orbits, the largest N, the distance of two N, the rows of the beginning with which the rest is compared.
ORBITS, LAST, APART, BEGINNING = 2000, 300.0, 0.5, 40
#: Rows are this many an orbit, no whole number, so that they meet all phases.
ROWS = 3.7
#: Long runs off all resonances: their orbits, steps an orbit, eccentricity, steps between rows.
LONG, OFF, ECCENTRIC, EVERY_TH = 5000, 251.0, 0.2, 16
#: Orbits of the control, and of the runs in which parasitic parts are seen.
SHORT = 1000
#: Parasitic parts are seen in differences of this order, in so many windows of a run, each of so many steps.
DIFFERENCE, WINDOWS, STEPS = 12, 96, 240
#: Steps an orbit at which a method is unstable; the control.
UNSTABLE, CONTROL = 132.0, "stormer-7"
#: An orbit is lost where the energy error is so many times as large as at first, or as large as the energy.
LOST, WHOLE = 1e3, 0.1
#: Theory decides where errors grow by exp(SURE) or more, or by less than exp(QUIET), over a run.
SURE, QUIET = 30.0, 1.0
#: Theory is about the exact orbit: it is asked where the energy error is below this at first.
SMALL = 1e-4
#: A resonance: an error that has grown by this factor, and by less than `LOST`; smaller errors are round-off.
GROWN, NOISE = 30.0, 1e-11


def chosen(label: str) -> Method:
    """The method with this id; for `CONTROL` Stormer's method of order 7."""
    if label != CONTROL:
        return BY_ID[label]
    data = tuple(stormer(7, 8))
    return replace(BY_ID["quinlan-tremaine-8"], id=label, order=7, symmetric=False, energy=DRIFT, data=data)


# -- theory ------------------------------------------------------------------------------------------------------------


def circular_rate(table: Multistep, N: float) -> float:
    """The logarithm of the factor per orbit by which errors grow on a circular orbit with N steps an orbit."""
    rho, sigma = np.array(table.rho, float), np.array(table.sigma, float)
    turn = np.exp(2j * np.pi / N * np.arange(len(rho)))
    K = -((rho @ turn) / (sigma @ turn)).real
    sides = [(rho - K / 2 * sigma) * t for t in (turn, turn.conj())]
    polynomial = np.convolve(*sides) - 9 / 4 * K**2 * np.convolve(sigma * turn, sigma * turn.conj())
    roots = np.roots(polynomial[::-1])
    parasitic = roots[np.abs(roots - 1) > 2.5 * np.pi / N]  # the others are 1 and near e^(i phi), of the orbit itself
    return float(np.log(np.abs(parasitic).max()) * N)


def orbit(e: float, t: np.ndarray) -> np.ndarray:
    """Positions (n, 2) at the times t on Kepler's orbit of semi-major axis 1 from pericentre, mu = 1."""
    E = np.array(t, float)
    for _ in range(60):
        E = E - (E - e * np.sin(E) - t) / (1 - e * np.cos(E))
    return np.stack([np.cos(E) - e, np.sqrt(1 - e**2) * np.sin(E)], axis=1)


def floquet_rate(table: Multistep, N: float, e: float) -> float:
    """The logarithm of the factor per orbit by which errors grow on an orbit of eccentricity e with N steps.

    It follows from the linearized steps of two orbits, so that 2 N must be an integer.
    """
    alpha, beta = np.array(table.rho, float), np.array(table.sigma, float)
    k, n, h = len(alpha) - 1, round(2 * N), 2 * np.pi / N
    q = orbit(e, h * np.arange(n))
    r = np.hypot(*q.T)[:, None, None]
    slope = h**2 * (3 * q[:, :, None] * q[:, None, :] / r**5 - np.eye(2) / r**3)
    q = list(np.eye(2 * k).reshape(k, 2, 2 * k))
    f = [slope[i % n] @ q[i] for i in range(k)]
    for i in range(k, k + n):
        new = sum(beta[j] * f[j] for j in range(1, k)) - sum(alpha[j] * q[j] for j in range(k))
        q, f = [*q[1:], new], [*f[1:], slope[i % n] @ new]
    return float(np.log(np.abs(np.linalg.eigvals(np.concatenate(q))).max()) / 2)


# -- runs --------------------------------------------------------------------------------------------------------------


def _run(method: Method, e: float, N: float, orbits: float, every: int) -> Solution:
    start = {"q0": [1 - e, 0.0], "p0": [0.0, ((1 + e) / (1 - e)) ** 0.5]}
    with np.errstate(all="ignore"):
        return integrate(problem("kepler"), method, h=2 * np.pi / N, steps=int(orbits * N), save_every=every, **start)


def limit(table: Multistep) -> float:
    """The fewest steps an orbit at which a method is stable on the oscillator."""
    return 2 * np.pi / stable_intervals(table)[0][1]


def steps_asked(table: Multistep) -> np.ndarray:
    """The numbers of steps an orbit at which a method is run, from its `limit` to `LAST`."""
    return np.arange(np.ceil(limit(table) / APART) * APART, LAST + APART / 2, APART)


def steps(method: str, e: float) -> list[dict]:
    """The energy error at first and at most, and the rate of growth by theory: a row for each number of steps."""
    made, rows = BY_ID[method], []
    table = Multistep(*made.data)
    for N in map(float, steps_asked(table)):
        s = _run(made, e, N, ORBITS, max(1, int(N / ROWS)))
        error = np.abs(s.energy() - s.energy()[0])
        theory = floquet_rate(table, N, e) if e else circular_rate(table, N)
        row = {"order": made.order, "e": e, "N": N, "rate": theory, "status": s.status}
        rows.append(row | {"first": float(error[:BEGINNING].max()), "largest": float(np.nanmax(error))})
    return rows


def long(method: str, N: float) -> dict:
    """The drift of the energy and the growth of parasitic parts over many orbits, with intervals."""
    made = chosen(method)
    s = _run(made, ECCENTRIC, N, LONG if method != CONTROL and N == OFF else SHORT, EVERY_TH)
    energy = drift(s.t / (2 * np.pi), s.energy())
    every = _run(made, ECCENTRIC, N, SHORT, 1).q
    begin = np.linspace(len(every) // WINDOWS, len(every) - STEPS - 1, WINDOWS).astype(int)
    # High differences of q are parasitic.
    sizes = np.array([np.abs(np.diff(every[b : b + STEPS], DIFFERENCE, axis=0)).max() for b in begin])
    growth = drift(begin / N, np.log(sizes))
    row = {"orbits": float(s.t[-1] / (2 * np.pi)), "status": s.status}
    row |= {"slope": energy.value, "low": energy.low, "high": energy.high}
    row |= {"growth": growth.value, "growth low": growth.low, "growth high": growth.high}
    return row | {"amplitude": float(sizes.max())}


# -- judging, and what is shown ----------------------------------------------------------------------------------------


@of(TABLE)
def judged(rows: pd.DataFrame) -> pd.DataFrame:
    """The runs with what they are judged by.

    ``factor`` is how many times the energy error has grown, infinite where it is as large as the energy; ``unstable``,
    whether errors surely grow by theory; ``decided``, whether they surely do or do not; ``near``, whether a run begins
    near the exact orbit, for which the theory is made.
    """
    factor = (rows["largest"] / rows["first"].clip(lower=NOISE)).where(rows["largest"] < WHOLE, np.inf)
    growth, near = rows["rate"] * ORBITS, (rows["e"] == 0) | (rows["first"] < SMALL)
    rows = rows.assign(factor=factor, lost=factor >= LOST, unstable=growth >= SURE, near=near)
    return rows.assign(decided=rows["unstable"] | (growth < QUIET))


def higher(rows: pd.DataFrame) -> pd.Series:
    """True where of two successive orders the higher one loses the orbit with more steps."""
    last = rows["N"].where(rows["lost"], 0.0).groupby([rows["e"], rows["order"]]).max()
    found = {
        f"e = {e:g}: order {b} to {y:g}, {a} to {x:g}": y > x
        for e, of_e in last.groupby(level=0)
        for (a, x), (b, y) in pairwise(of_e[e].items())
    }
    return pd.Series(found, dtype=bool)


def _lowest(rows: pd.DataFrame) -> str:
    found = higher(rows)
    return "; ".join(found.index[~found][:2])


@of(judged)
def counts(rows: pd.DataFrame) -> pd.DataFrame | None:
    """The numbers of steps at which an orbit is lost, on the circle and on the ellipse, by method."""
    found = rows.groupby(["method", "e"])["lost"].sum().unstack()
    return found.set_axis(["circle", "ellipse"], axis=1) if found.shape[1] == 2 else None


def _fewest(found: pd.DataFrame) -> str:
    name = (found["ellipse"] / found["circle"].clip(lower=1)).idxmin()
    return "{}: {:.0f} on the circle, {:.0f} on the ellipse".format(name, *found.loc[name])


def _bounded(rows: pd.DataFrame, every: pd.DataFrame) -> Count:
    """The intervals of growth, of the energy and of parasitic parts, that contain 0."""
    kept = [(rows[f"{name}low"] <= 0) & (rows[f"{name}high"] >= 0) for name in ("", "growth ")]
    return Count(int(sum(k.sum() for k in kept)), 2 * len(rows))


def _control(rows: pd.DataFrame, every: pd.DataFrame) -> str:
    slopes = every.loc[every["method"] == CONTROL, "slope"]
    return f"{CONTROL}, the control: {number(slopes.iloc[0], 2)} an orbit" if len(slopes) else ""


def spans(N: pd.Series) -> str:
    """Numbers of steps an orbit as text, neighbours (`APART` apart) as ranges: "59.5 to 60, 90"."""
    ends = N.groupby((N.diff() > APART * 1.01).cumsum()).agg(["min", "max"])
    return ", ".join(f"{a:g}" if a == b else f"{a:g} to {b:g}" for a, b in ends.to_numpy())


@of(judged)
def _table(rows: pd.DataFrame) -> Table:
    out = []
    for (method, e), own in rows.groupby(["method", "e"], sort=False):
        stable = limit(QUINLAN_TREMAINE[int(own["order"].iloc[0])])
        slow = own["N"][~own["lost"] & (own["factor"] >= GROWN) & (own["largest"] > NOISE)]
        grows = ", ".join(f"{x:g}" for x in slow[:12]) + (f" and {len(slow) - 12} more" if len(slow) > 12 else "")
        row = {"method": method, "e": e, "limit on the oscillator": f"{stable:.2f}"}
        out.append(row | {"lost at": spans(own["N"][own["lost"]]), "errors grow at": grows})
    caption = (
        f"Steps an orbit, {APART:g} apart up to {LAST:g}, at which {ORBITS} orbits are lost (the energy error grows "
        f"{LOST:g}-fold or to {WHOLE:g}), or their error grows more than {GROWN:g}-fold: resonances."
    )
    far = rows[rows["decided"] & ~rows["near"]]
    off = far[far["lost"] != far["unstable"]].groupby("method", sort=False)["N"].agg(["max", "size"])
    if len(off):
        names = [f"{id} up to {N:g} steps an orbit" for id, N in off["max"].items()]
        caption += (
            f" Of {len(far)} steps whose energy error exceeds {SMALL:g} at first, where theory is not asked, it would "
            f"be wrong at {off['size'].sum()}: {join_list(names, 4)}."
        )
    return Table(pd.DataFrame(out), caption)


@picture(
    judged, "extremes-multistep", "unstable steps on Kepler's orbit",
    f"Kepler, {ORBITS} orbits: the factor by which the largest energy error exceeds that at first; below, where "
    "the linear theory about the orbit is unstable.",
)  # fmt: skip
def _draw(rows: pd.DataFrame) -> style.Figure:
    methods = rows["method"].unique()
    figure, by_method = style.grid(methods, 2, 4.9, "steps an orbit", "growth of the energy error")
    for id, axes in by_method.items():
        for e, colour in zip(ECCENTRICITIES, (style.ORANGE, style.BLUE), strict=True):
            own = rows[(rows["method"] == id) & (rows["e"] == e)]
            axes.semilogy(own["N"], own["factor"].clip(1, 1e10), color=colour, linewidth=0.8, label=f"e = {e:g}")
            theory = own["N"][own["unstable"]]
            axes.plot(theory, np.full(len(theory), 0.2 if e else 0.5), "|", color=colour, markersize=5)
        axes.set(title=id, ylim=(0.1, 3e10))
    figure.axes[0].legend(loc="upper right")
    return figure


AT = "{method} at {N:g} steps an orbit"
STUDY = Study(
    id="extremes-multistep",
    place=230,
    question="At which steps do symmetric multistep methods fail on Kepler's orbit?",
    answer="Symmetric multistep methods lose Kepler's orbit at oscillator-stable steps: linear theory about the orbit "
    "foretells {both} outcomes; off resonance {bounded} growth intervals hold zero.",
    setting=(
        "Kepler, H = |p|² / 2 − 1 / |q|, semi-major axis 1; quinlan-tremaine-8 to -14, started by Gauss, with N steps "
        "an orbit from the stability limit on the oscillator on.",
        "Theory, e = 0: roots of ρ₊ρ₋ − (9/4) K² σ₊σ₋ with ρ± = ρ(e^(±iφ) z) − (K/2) σ(e^(±iφ) z), φ = 2π / N, "
        "K = −ρ(e^(iφ)) / σ(e^(iφ)). e > 0: eigenvalues of the linearized steps of two orbits, multiplied.",
        "The claims on orders and frequencies are those of the abstract of G. D. Quinlan, arXiv:astro-ph/9901136 "
        "(1999).",
        f"Growth: {LONG} orbits with {OFF:g} steps each, e = {ECCENTRIC:g}; parasitic parts are differences of order "
        f"{DIFFERENCE} of q in {WINDOWS} windows; drifts with intervals as on [the page of drifts](drift.md).",
        f"Control: {CONTROL}, Stormer's method, not symmetric, by the same kernel.",
    ),
    runs=(
        Runs(TABLE, steps, [{"method": id, "e": e} for id in METHODS for e in ECCENTRICITIES],
             needs=lambda method, e: (BY_ID[method], ProblemKey("kepler"))),
        Runs(DRIFTS, long, [*over(method=METHODS, N=(OFF,)), {"method": METHODS[-1], "N": UNSTABLE},
                            {"method": CONTROL, "N": OFF}],
             needs=lambda method, N: (chosen(method), ProblemKey("kepler"))),
    ),
    claims={
        "circle": Claim(
            "A circular orbit is lost at the steps at which its linear theory is unstable",
            judged, "lost == unstable", rows="decided and e == 0", unit="step sizes", where=AT, names=3,
        ),
        "ellipse": Claim(
            "An eccentric orbit is lost at the steps at which a Floquet multiplier exceeds one",
            judged, "lost == unstable", rows="decided and near and e > 0", unit="step sizes", where=AT, names=3,
        ),
        "order": Claim(
            "Instabilities reach smaller steps, the higher the order",
            judged, higher, unit="pairs of orders", where=_lowest,
        ),
        "frequencies": Claim(
            "An eccentric orbit has more unstable steps than a circular one",
            counts, "ellipse > circle", unit="methods", where=_fewest,
        ),
        "bounded": Claim(
            "Off the resonances neither the energy nor a parasitic part grows",
            DRIFTS, _bounded, rows=f"method != '{CONTROL}' and N == {OFF}", unit="intervals", where=_control,
            beside=(DRIFTS,),
        ),
    },
    numbers={
        "both": Claim(
            "An orbit is lost at the steps at which theory is unstable",
            judged, "lost == unstable", rows="decided and near",
        ),
    },
    figure=_draw,
    shown=_table,
    whole=of(judged)(lambda rows: rows.loc[rows["lost"] | rows["unstable"], :"largest"]),
    limits=(
        "Nothing is judged where theory has errors grow, but hardly in so many orbits; nor, as the theory is about the "
        f"exact orbit, on an ellipse whose energy error exceeds {SMALL:g} in the first orbits.",
        "Resonances, where an orbit is a whole number of parasitic periods, let errors grow like the time: longer runs "
        "show more of them.",
        "Only the abstract of Quinlan's paper was at hand: the steps an orbit that its text prints are not compared.",
        "Grid points that are no multiples of the spacing are not tried: a narrower unstable interval between two of "
        "them is not seen.",
    ),
    within="extremes",
    listed=False,
)  # fmt: skip
