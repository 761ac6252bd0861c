"""Energy errors of the energy-preserving Schemes IV and V, alone and combined, and their steps without a root lambda.

Runs end at t = 1000.  In each step a scheme chooses its parameter lambda so that the energy after the step is the
initial one; not every step has such a root.  A combined scheme tries the other scheme where the first has no root.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import root_scan
from phasebench.benchmarks.page.page import Table, of
from phasebench.benchmarks.page.shared import most, picture, total
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import NONE, Count, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import integrate
from phasebench.integrators.families.schemes_iv_v import RADIUS
from phasebench.integrators.registry import BY_ID

if TYPE_CHECKING:
    import sympy as sp

    from phasebench.integrators.solution import Solution

TABLE = "energy_preservation"
PROBLEMS = ("henon-heiles:box", "henon-heiles:chaotic", "perturbed-kepler")
PLAIN, ALTERNATING = ("scheme-iv", "scheme-v"), ("scheme-iv-v", "scheme-v-iv")
LADDER = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
#: An energy error up to this, on steps with a root, is round-off.
ROUND_OFF = 1e-13
WITH, WITHOUT = "energy error, steps with a root", "energy error, steps without"
PLACE = "{scheme} on {problem}, h = {h:g}"
ROOTED = total("steps - `without a root`", "steps")


def measure(problem: str, scheme: str, h: float) -> dict:
    """The energy errors of a scheme to t = 1000; its steps without a root are scanned for one independently."""
    found = problem_of(problem)
    path, plain = (integrate(found, id, h=h, t_end=1000.0) for id in (scheme, "implicit-midpoint"))

    def off(s: Solution, expression: sp.Expr) -> np.ndarray:
        values = found.system.observe(expression, s.q, s.p)
        return np.abs(values - values[0])

    error, rootless = off(path, found.system.H)[1:], np.isnan(path.parameter)
    after, good = np.flatnonzero(rootless[:-1] & ~rootless[1:]) + 1, path.parameter[~rootless]
    row = {
        "status": path.status,
        "steps": path.counts["steps"],
        "without a root": int(rootless.sum()),
        WITH: float(error[~rootless].max()),
        WITHOUT: float(error[rootless].max()) if rootless.any() else np.nan,
        "one step later": float(error[after].max()) if len(after) else np.nan,
        "implicit midpoint's energy error": float(off(plain, found.system.H).max()),
    }
    if "angular-momentum" in found.invariants:
        row["angular momentum error"] = float(off(path, found.invariants["angular-momentum"]).max())
    row |= {"least lambda": float(good.min()), "greatest lambda": float(good.max())}
    row["evaluations per step"] = path.counts["gradient"] / path.counts["steps"]
    steps = np.flatnonzero(rootless)
    if not len(steps) or scheme not in root_scan.SIGNS:
        return row
    H0 = float(found.system.observe(found.system.H, path.q[:1], path.p[:1])[0])
    checked = root_scan.scan(found, scheme, path.h, path.q[steps], path.p[steps], H0)
    roots = [r[0] for r in checked.roots if len(r)]
    return row | {
        "scanned steps": len(steps),
        "scan finds a root within the radius": sum(abs(root - 0.5) < RADIUS for root in roots),
        "nearest root beyond it": min(roots, key=lambda lam: abs(lam - 0.5), default=np.nan),
    }


def ran(schemes: tuple[str, ...]) -> str:
    """The query of the completed runs of some schemes."""
    return f"scheme in {schemes} and status == 'ok'"


def missed(rows: pd.DataFrame) -> Count | None:
    """The steps in which the scan finds a root that the finder did not, of those that were scanned."""
    scanned = int(rows["scanned steps"].sum()) if "scanned steps" in rows else 0
    return Count(int(rows["scan finds a root within the radius"].sum()), scanned) if scanned else None


@picture(
    TABLE, "energy_preservation", "energy errors over the step",
    "Largest energy error to t = 1000 over the step size, on steps with and without a root, beside that of the "
    "implicit midpoint rule.",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure:
    shown = {
        "Scheme IV, steps with a root": ("scheme-iv", WITH),
        "Scheme V, steps with a root": ("scheme-v", WITH),
        "Scheme IV, steps without": ("scheme-iv", WITHOUT),
        "implicit midpoint": ("scheme-iv", "implicit midpoint's energy error"),
    }

    def curves(axes: style.Axes, rows: pd.DataFrame) -> None:
        for k, (label, (scheme, column)) in enumerate(shown.items()):
            part = rows[rows["scheme"] == scheme].sort_values("h")
            axes.loglog(part["h"], part[column], label=label, **style.curve(k))

    problems = frame.groupby("problem", sort=False)
    return style.row(problems, curves, 3.0, "$h$", "largest energy error", legend=2, sharey=True)


SAME = ("problem", "scheme", "h", "steps", "without a root")
COLUMNS = dict(zip(SAME, SAME, strict=True)) | {
    WITH: "energy error with one",
    WITHOUT: "without",
    "one step later": "one step later",
    "least lambda": "least λ",
    "greatest lambda": "greatest λ",
}


@of(TABLE)
def _table(frame: pd.DataFrame) -> Table:
    order = frame.assign(none=frame["without a root"] == 0).sort_values(["none", WITH], ascending=[True, False])
    caption = (
        "Runs that have steps without a root, then those of the largest energy error. Energy errors: on steps with a "
        "root, on steps without, and one step after these, where a root restores H₀."
    )
    return Table(order.head(18)[list(COLUMNS)].rename(columns=COLUMNS), caption)


STUDY = Study(
    id="energy_preservation",
    place=170,
    question="Do Schemes IV and V keep the energy on every step?",
    answer="Schemes IV and V keep the energy to {energy} up to t = 1000, except on {without} of {roots.of} steps "
    "without a suitable λ, where the error reaches {reached}.",
    setting=(
        "In each step the parameter λ near 1/2 is a root of E(λ, h) = H(q₁(λ), p₁(λ)) − H₀.",
        "Hénon–Heiles (box, chaotic) and perturbed Kepler to t = 1000, h from 0.2 to 0.005.",
        "A step without a root is taken with λ = 1/2; since the target remains H₀, a later step restores the energy.",
        "scheme-iv-v takes such a step by Scheme V, and scheme-v-iv takes by Scheme IV a step that Scheme V cannot.",
        "The scan follows the stage equations in λ from 1/2 until they lose their solution, at most by 60; it shares "
        "no code with the root finder.",
    ),
    runs=(
        Runs(
            TABLE, measure,
            [{"problem": p, "scheme": s, "h": h} for p in PROBLEMS for s in (*PLAIN, *ALTERNATING) for h in LADDER],
            needs=lambda problem, scheme, h: (BY_ID[scheme], BY_ID["implicit-midpoint"], ProblemKey(problem)),
        ),
    ),
    claims={
        "energy": Claim(
            "On steps with a root the energy error is of round-off",
            TABLE, f"`{WITH}`", at_most(ROUND_OFF), rows=ran(PLAIN), where=PLACE, fault=True,
        ),
        "roots": Claim(
            "Every step of Schemes IV and V has a root",
            TABLE, ROOTED, rows=ran(PLAIN), unit="steps",
            where=most("`without a root`", f"{PLACE}: {{without a root}} steps without"),
        ),
        "search": Claim(
            "The root finder misses no root that an independent scan finds",
            TABLE, missed, NONE, rows=ran(PLAIN), unit="steps without a root", fault=True,
        ),
        "alternating": Claim(
            "Every step has a root of Scheme IV or of Scheme V",
            TABLE, ROOTED, rows=ran(ALTERNATING), unit="steps", where=most("`without a root`", PLACE),
        ),
    },
    numbers={
        "energy": Number(TABLE, f"`{WITH}`", ran(PLAIN), digits=2),
        "without": Number(TABLE, "`without a root`", ran(PLAIN), pd.Series.sum),
        "reached": Number(TABLE, f"`{WITHOUT}`", ran(PLAIN), digits=2),
    },
    checks={
        "kept": Claim("The energy is kept to round-off", TABLE, f"`{WITH}`", at_most(1e-14), rows="status == 'ok'"),
        "momentum": Claim("The angular momentum is kept to round-off", TABLE, "`angular momentum error`",
                          at_most(5e-14), rows="status == 'ok' and problem == 'perturbed-kepler'"),
    },
    figure=_draw,
    shown=_table,
    limits=(
        f"An energy error of at most {ROUND_OFF:g} counts as round-off. Roots are sought within |λ − 1/2| < "
        f"{RADIUS:g}.",
        "A step without a root counts, though the energy is restored after it.",
        "These are three orbits: another one may more often pass where no root exists.",
    ),
)  # fmt: skip
