"""What packages' guides say of integrators, beside what is measured on the problems that they name.

Methods have their names in OrdinaryDiffEq.jl: McAte2 to McAte5 are McLachlan and Atela's of orders 2 to 5, KahanLi8
is Kahan and Li's of order 8, VelocityVerlet is the Stormer-Verlet method.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from phasebench.benchmarks.page import said
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data, Picture
from phasebench.benchmarks.page.study import Claim, Curves, Study, pictures
from phasebench.benchmarks.page.verdict import at_least, at_most

from . import brouwer, energies, julia

#: The table of another page, with the energy errors and times of all of REBOUND's Wisdom-Holman settings.
RIVALS, COST = "wisdom_holman_rivals", "ns a unit of time"
#: The energy errors for which times are compared.
ERRORS = tuple(10.0**-k for k in range(4, 14))
#: WHFast with each kernel and corrector 17, by the kernel's name.
KERNELS = {
    "rebound-whfast": "lazy",
    "rebound-whfast-corrector-17": "default",
    "rebound-whfast-modifiedkick": "modified kick",
    "rebound-whfast-composition": "composition",
}
#: WHFast's correctors with the default kernel, those of high order last; energy errors nearer than this are equal.
CORRECTORS, EQUAL = [f"rebound-whfast-corrector-{n}" for n in (3, 5, 7, 11, 17)], 1.05
#: Methods that the figure shows.
SHOWN = ("stormer-verlet", "mclachlan-atela-2", "mclachlan-atela-3", "calvo-sanz-serna-4", "kahan-li-6", "kahan-li-8")


def cheapest(rows: pd.DataFrame) -> pd.Series:
    """The fastest method by the energy error that it reaches and the problem."""
    found = {}
    for error in ERRORS:
        for name, part in rows[rows["energy error"] <= error].groupby("problem"):
            found[error, name] = part.loc[part[COST].idxmin(), "method"]
    return pd.Series(found, dtype=object)


def fastest(rows: pd.DataFrame) -> pd.Series:
    """True for each energy error for which WHFast is fastest."""
    best = cheapest(rows)
    return best.str.startswith("rebound-whfast").set_axis([f"{best[key]} to {key[0]:g}" for key in best.index])


def correctors(rows: pd.DataFrame) -> pd.Series:
    """True for each problem and step where corrector 11 or 17 has the smallest energy error, the worst first."""
    found = rows.pivot_table(index=["problem", "h"], columns="method", values="energy error")
    found = found.reindex(columns=CORRECTORS).dropna()
    high = (found[CORRECTORS[-2:]].min(axis=1) / found.min(axis=1)).sort_values(ascending=False, kind="stable")
    return (high <= EQUAL).set_axis([f"{name}: {number(x)} times" for (name, _), x in high.items()])


def kernels(rows: pd.DataFrame) -> pd.Series:
    """The fastest kernel by energy error and problem."""
    return cheapest(rows[rows["method"].isin(KERNELS)]).map(KERNELS)


def lazy(rows: pd.DataFrame) -> pd.Series:
    """True where the lazy kernel is fastest."""
    return kernels(rows) == "lazy"


def other_kernels(rows: pd.DataFrame) -> str:
    """How often another kernel is fastest."""
    others = kernels(rows).value_counts().drop("lazy", errors="ignore")
    return ", ".join(f"{kernel} {n}" for kernel, n in others.items())


CURVES = [
    Curves(
        julia.COST, "evaluations", "error", "evaluations of the gradient", label, "called",
        rows=f"problem == '{problem}' and method in {SHOWN}", title=problem.partition(":")[0],
    )
    for problem, label in (("henon-heiles:box", "error of the state"), ("outer-solar-system", ""))
]  # fmt: skip


def draw(data: Data, folder: Path) -> list[Picture] | None:
    """Error against gradient evaluations on two problems, a curve for each of a few methods."""
    caption = (
        "Error of the state over the evaluations of the gradient: McAte2 beside VelocityVerlet and methods of higher "
        "order."
    )
    return pictures(CURVES, data, folder, "field-says-cost.png", "error against evaluations", caption, 3, 3.2)


SAID = said.statements(
    Path(__file__).with_suffix(".toml"), {**vars(julia), **vars(energies), **vars(brouwer), **globals()}
)
STUDY = Study(
    id="field-says",
    place=100,
    question="Does what packages' guides say of integrators hold?",
    answer=said.answer(
        SAID.values(),
        "Of {n} statements of packages' guides {hold} hold where they were tested; {fail} do not.",
    ),
    setting=(
        f"Growth: a Kepler orbit of e = 0.2, {julia.ORBITS} revolutions, the power of n in the largest energy error of "
        "a revolution and in the position's error after it.",
        f"Cost: {len(julia.SCENES)} problems, errors of the state from 0.1 to 1e-10 against Gauss of order 16, "
        f"{len(julia.METHODS)} methods of OrdinaryDiffEq.jl's list that are here.",
        "Energy: the starts and times of SciMLBenchmarks.jl, KahanLi8 with h = 0.01, in compensated and in plain sums; "
        "for Vern9, DPRKN12 and their Taylor methods stand DOP853 and heyoka.",
        f"IAS15: Kepler orbits, {energies.ORBITS} revolutions, energies in extended precision. WHFast: all its "
        "settings and SABA, energy error and time, from [Wisdom–Holman splittings](wisdom_holman.md).",
    ),
    runs=(*julia.RUNS, *energies.RUNS),
    reads=(brouwer.TABLE, RIVALS),
    claims=said.claims(SAID, shown=True),
    numbers=said.claims(SAID, shown=False),
    checks={
        "references": Claim("References are known", julia.COST, "uncertainty", at_most(1e-11)),
        "control": Claim(
            "The energy error of the control grows",
            julia.GROWTH,
            "`energy power`",
            at_least(0.5),
            "symplectic == False",
        ),
    },
    figure=draw,
    shown=said.table(
        SAID,
        "A power of time is met within 0.1; `printed`: the guide's words, in part; `where`: the worst case, or "
        "details.",
    ),
    limits=(
        "The methods run here are this suite's with the same coefficients, not Julia's programs.",
        "Statements are quoted in part; the whole text stands at the source, and may have changed since.",
        "“For most applications” has no definition: five problems and ten errors stand for them.",
    ),
)
