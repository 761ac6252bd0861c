r"""The local conservation laws of box schemes for wave equations in space-time, with period 2 pi in space.

Smooth data of few modes: for the nonlinear Schroedinger equation :math:`\psi = 1 + 0.4\cos x + 0.2i\sin x`, for the
Klein-Gordon equation :math:`\phi = 1 + 0.5\cos x + 0.3i\sin x`,
:math:`\phi_t = 0.2\sin x + i(0.5 + 0.2\cos x)`; the tangents have the first two modes.  Decreasing steps on the
coarsest mesh show the order in time, finer meshes at one step the order in space.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import box_laws, metrics
from phasebench.benchmarks.measure.box_laws import ENERGY, FOLLOWS, MOMENTUM, TWO_FORM
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.problems import klein_gordon, nls
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families.multisymplectic import Scheme, run, scheme, schemes
from phasebench.integrators.systems.multisymplectic import Equation

TABLE = "multisymplectic"
#: Numbers of mesh cells for the order in space; the first is used for the order in time.
CELLS = (17, 25, 33, 49, 65)
#: Number of halvings of the longest step; length of the integrations in longest steps; steps of the runs over `CELLS`.
HALVINGS, LONG, FEW = 3, 10, 4
IN_TIME, IN_SPACE = "time", "space"
#: A residual of at most this many units of round-off counts as round-off.
UNITS = 10.0
#: Largest difference of a measured order from the expected one that counts as agreement; the order in space of all.
NEAR, IN_SPACE_ORDER = 0.1, 2
#: Largest error of a total (energy, mass, charge) that counts as preserved.
KEPT = 1e-12


class Case(NamedTuple):
    """A wave equation with its initial values, tangents, invariant and longest steps."""

    equation: Equation
    #: Function x -> (y, u, v), arrays (N, m): initial values and two tangents (data of the linearized equation).
    data: Callable
    #: Function y -> the quadratic invariant, a sum over the mesh cells.
    invariant: Callable
    #: Largest step of the runs; of the Euler box scheme, whose stability limits it.
    longest: float
    longest_euler: float


def _schroedinger(x: np.ndarray) -> Iterator[np.ndarray]:
    one, c, s = np.ones_like(x), np.cos(x), np.sin(x)
    return (np.stack(columns, axis=1) for columns in ((1 + 0.4 * c, 0.2 * s), (c, np.sin(2 * x)), (s, one)))


def _klein_gordon(x: np.ndarray) -> Iterator[np.ndarray]:
    one, c, s = np.ones_like(x), np.cos(x), np.sin(x)
    start = (1 + 0.5 * c, 0.3 * s, 0.2 * s, 0.5 + 0.2 * c)
    tangents = (c, np.sin(2 * x), one, s), (s, one, np.cos(2 * x), c)
    return (np.stack(columns, axis=1) for columns in (start, *tangents))


def mass(y: np.ndarray) -> float:
    """The sum of |psi|^2; y = (Re, Im) of psi, array (N, 2)."""
    return float((y**2).sum())


def charge(y: np.ndarray) -> float:
    """The sum of q1 p2 - q2 p1; y = (q1, q2, p1, p2), array (N, 4)."""
    return float((y[:, 0] * y[:, 3] - y[:, 1] * y[:, 2]).sum())


CASES = {
    "nls": Case(nls.multisymplectic(), _schroedinger, mass, 0.03, 0.004),
    "klein-gordon": Case(klein_gordon.multisymplectic(), _klein_gordon, charge, 0.08, 0.08),
}


def ladder(case: Case, chosen: Scheme) -> dict[tuple[str, int, float], int]:
    """(What gets finer, number N of mesh cells, h) -> number of steps: first h falls, then the mesh gets finer."""
    h = case.longest_euler if chosen.id == "euler-box" else case.longest
    in_time = {(IN_TIME, CELLS[0], h / 2**k): LONG * 2**k for k in range(HALVINGS + 1)}
    return in_time | {(IN_SPACE, N, h / 2**HALVINGS): FEW for N in CELLS}


def measure(equation: str, id: str, falls: str, N: int, h: float, steps: int | None = None) -> dict:
    """The residuals of the conservation laws of a box scheme, with N mesh cells and the step h."""
    case, chosen = CASES[equation], scheme(id)
    steps = steps or ladder(case, chosen)[falls, N, h]
    row = {"equation": equation, "id": id, "scheme": chosen.name, "falls": falls, "N": N, "h": h, "steps": steps}
    row |= {"order": chosen.order, "multisymplectic": chosen.multisymplectic, "keeps": chosen.keeps}
    dx = 2 * np.pi / N
    y, *tangents = case.data(dx * np.arange(N))
    space = chosen.division(case.equation, N, dx)
    try:
        ran = run(case.equation, chosen, y, dx, h, steps, tangents)
        found = box_laws.measure(space, chosen, ran, h, case.invariant)
    except (ArithmeticError, InvalidInput) as error:
        return row | {"status": "not-converged", "reason": str(error)}
    return row | {"status": OK, "reason": ""} | found


def _needs(equation: str, id: str, falls: str, N: int, h: float) -> tuple:
    chosen = scheme(id)
    numbers = map(str, (chosen.A_q, chosen.A_p, chosen.b, chosen.S, ladder(CASES[equation], chosen)[falls, N, h]))
    return (ProblemKey(equation), *numbers)


def _is_round_off(rows: pd.DataFrame, law: str) -> pd.Series:
    return rows[law] <= UNITS * rows[f"{law}, round-off"]


def _order(part: pd.DataFrame, law: str, falls: str) -> float:
    """The order of a law's residuals in the step or in the mesh width; NaN if they are round-off."""
    part = part[(part["falls"] == falls) & ~_is_round_off(part, law)]
    return metrics.order(part["h"] if falls == IN_TIME else 1 / part["N"], part[law]).value


@of(TABLE)
def cases(frame: pd.DataFrame) -> pd.DataFrame:
    """A row for each equation and scheme: its orders, and which laws and totals its completed runs keep."""
    rows = []
    for (equation, id), part in frame[frame["status"] == OK].groupby(["equation", "id"], sort=False):
        first, in_time = part.iloc[0], part[part["falls"] == IN_TIME]
        units = part[TWO_FORM] / part[f"{TWO_FORM}, round-off"]
        rows.append(
            {"equation": equation, "id": id, "declared": bool(first["multisymplectic"])}
            | {name: first[name] for name in ("scheme", "keeps", "order")}
            | {"two-form kept": _is_round_off(part, TWO_FORM).all(), "units": units.max(), "least": units.min()}
            | {"relative": (part[TWO_FORM] / part[f"{TWO_FORM}, largest term"]).max()}
            | {"follows kept": _is_round_off(part, FOLLOWS).all()}
            | {"cell energy kept": _is_round_off(in_time, ENERGY).all(), "missed": part["steps without a root"].sum()}
            | {"energy order": _order(part, ENERGY, IN_TIME), "momentum order": _order(part, MOMENTUM, IN_SPACE)}
            | {name: part[name].max() for name in ("total energy error", "quadratic invariant error")}
        )
    return pd.DataFrame(rows)


def energy_kept(rows: pd.DataFrame) -> pd.Series:
    """True for schemes that keep the energy of every cell, or in total, as they are built to."""
    return rows["cell energy kept"].where(rows["keeps"] == "cell", rows["total energy error"] <= KEPT).astype(bool)


@picture(
    TABLE, "multisymplectic", "residuals of local laws",
    f"Largest residuals over all cells of space-time, {CELLS[0]} cells in space: of the multisymplectic law (above, "
    "relative to its largest term) and of the energy law (below).",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure | None:
    rows = frame[(frame["status"] == OK) & (frame["falls"] == IN_TIME)]
    if rows.empty:
        return None
    equations = rows.groupby("equation", sort=False)
    figure, grid = style.panels(2, len(equations), 5.0, sharex="col", sharey="row")
    for (above, below), (name, part) in zip(grid.T, equations, strict=True):
        for k, label in enumerate(rows["scheme"].unique()):
            one = part[part["scheme"] == label]
            relative = one[TWO_FORM] / one[f"{TWO_FORM}, largest term"]
            for axes, values in ((above, relative), (below, one[ENERGY])):
                axes.loglog(one["h"], np.maximum(values, 1e-17), label=label, **style.curve(k))
                axes.grid(color="0.93", linewidth=0.5)
        above.set_title(name)
        below.set_xlabel("$h$")
    grid[0, 0].set_ylabel("two-form, relative")
    grid[1, 0].set_ylabel("energy law")
    style.legend_above(figure, grid[0, 0], 4)
    return figure


COLUMNS = {
    "equation": "equation",
    "scheme": "scheme",
    "units": "two-form (units of round-off)",
    "relative": "relative to its terms",
    "energy order": "order of the energy residual in h",
    "momentum order": "of the momentum residual in Δx",
    "total energy error": "total energy error",
    "quadratic invariant error": "mass or charge error",
    "missed": "steps without a root",
}


@of(cases)
def _table(rows: pd.DataFrame) -> Table:
    caption = "The largest values over all runs of a case; an order is empty where the residual is round-off."
    total = rows[rows["keeps"] == "total"]
    if len(total):
        law = "holds" if total["follows kept"].all() else "fails"
        caption += f" The two-form's law is that at fixed α; with EQUIP's α following the state it {law}."
    return Table(rows[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


CASE = {"unit": "cases", "where": "{scheme} ({equation})", "names": 4}
STUDY = Study(
    id="multisymplectic",
    place=320,
    question="Do box schemes keep the local conservation laws in every cell of space-time?",
    answer="In every cell of space-time box schemes keep the multisymplectic law of Schrödinger and Klein–Gordon "
    "equations to {kept} units of round-off; controls miss it by {missed} and more.",
    setting=(
        "K z_t + L z_x = ∇S(z), period 2π: i ψ_t + ψ_xx + 2|ψ|²ψ = 0, and φ_tt = φ_xx − φ − |φ|²φ, complex.",
        "Laws: two-form (uᵀKv)_t + (uᵀLv)_x = 0 of two linearized solutions u, v; energy (S − zᵀLz_x/2)_t + "
        "(zᵀLz_t/2)_x = 0; momentum (zᵀKz_x/2)_t + (S − zᵀKz_t/2)_x = 0.",
        "Preissmann's box: the midpoint rule in space and time. Gauss and EQUIP box: two Gauss nodes in time; EQUIP's "
        "parameter α keeps the total energy. Euler box: symplectic Euler in both.",
        "Controls: AVF in time (keeps the energy of every cell), Radau IIA, and a midpoint rule with 0.501 for 1/2.",
    ),
    runs=(
        Runs(
            TABLE, measure,
            [
                {"equation": name, "id": id, "falls": falls, "N": N, "h": h}
                for name, case in CASES.items() for id, one in schemes().items() for falls, N, h in ladder(case, one)
            ],
            needs=_needs,
        ),
    ),
    claims={
        "two-form": Claim(
            "Multisymplectic schemes keep the two-form's law in every cell, to round-off",
            cases, "`two-form kept`", rows="declared", fault=True, **CASE,
        ),
        "controls": Claim(
            "Control schemes break the two-form's law by more than round-off",
            cases, f"least > {UNITS}", rows="not declared", fault=True, **CASE,
        ),
        "energy": Claim(
            "Schemes built to keep the energy, of every cell or in total, keep it",
            cases, energy_kept, rows="keeps in ('cell', 'total')", fault=True, **CASE,
        ),
        "order": Claim(
            "The residual of the energy law falls with the scheme's order in time",
            cases, f"abs(`energy order` - order) < {NEAR}", rows="declared", **CASE,
        ),
        "momentum": Claim(
            "The residual of the momentum law falls as Δx²",
            cases, f"abs(`momentum order` - {IN_SPACE_ORDER}) < {NEAR}", rows="declared", **CASE,
        ),
    },
    numbers={
        "kept": Number(cases, "units", "declared", digits=2),
        "missed": Number(cases, "least", "not declared", pd.Series.min, digits=2),
    },
    checks={"runs": Claim("Every run came to its end", TABLE, "status == 'ok'")},
    figure=_draw,
    shown=_table,
    limits=(
        f"A residual up to {UNITS:g} units counts as round-off; a unit is eps times the square of the largest slope on "
        "the mesh (the last digit of its highest mode), for energy and momentum also divided by h.",
        f"A measured order must be within {NEAR} of the expected one; a total counts as kept up to {KEPT:g}. The "
        "number of cells is odd, without which the box scheme on a period may have no solution.",
        "On a fixed mesh these are methods in time for Hamiltonian systems: for the Euler box see the page on "
        "[waves](waves.md).",
    ),
    within="waves",
)  # fmt: skip
