"""The report page on solving the implicit steps of lattices: banded Newton beside the usual solver.

The usual solver is the fixed-point iteration, with Newton's method in full matrices where that fails.
"""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Range, Verdict, at_most

from .large import exponent
from .page import ABOVE, at
from .solvers import FEW, FEWEST, FULL, LATTICES, METHOD, ROUNDS, TABLE

#: Ends that differ by less than this, relative to the state, count as equal.
SAME = 1e-12
#: The sizes of the table.
SHOWN = (32, 128, 2048, 10_000)


def _long(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the rows of the steps that are too long for the fixed-point iteration to contract."""
    return rows[rows["step"] == "long"]


def _places(rows: pd.DataFrame) -> str:
    return join_list([at(r) for r in rows.to_dict("records")], 3) if len(rows) else ""


@of(TABLE)
def solves(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether Newton's method with banded matrices solves the steps too long for the fixed-point iteration."""
    long = _long(rows)
    solved = long["solved, banded"].astype(bool)
    return Verdict(
        "Newton's method in the band solves steps too long for the fixed point",
        Count(int(solved.sum()), len(long)),
        EVERY,
        "cases",
        _places(long[~solved]),
        FAIL,
    )


@of(TABLE)
def same(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether banded Newton and the usual solver end at the same state, within `SAME`.

    None if no row has both.
    """
    both = rows.dropna(subset=["apart"])
    if both.empty:
        return None
    worst = both.loc[both["apart"].idxmax()]
    return Verdict(
        "The band and the usual solver come to the same state",
        float(worst["apart"]),
        at_most(SAME),
        "of the state",
        at(worst),
        FAIL,
    )


@of(TABLE)
def faster(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether banded Newton is faster than full matrices at long steps, by the whole interval of the ratio.

    None if both are timed in no row.
    """
    both = _long(rows).dropna(subset=["banded / usual"])
    if both.empty:
        return None
    low, high = both["banded / usual, low"].min(), both["banded / usual, high"]
    return Verdict(
        "At such long steps the band is faster than full matrices",
        Range(low, high.max()),
        at_most(1),
        "times the time",
        at(both.loc[high.idxmax()]),
    )


def _exponents(rows: pd.DataFrame) -> pd.DataFrame:
    """Fit, for each lattice, the powers of d with which banded Newton's time and memory of a long step grow.

    The columns of the result are system, time (the power), low (the lower end of its interval) and memory.
    """
    found = []
    for name, part in _long(rows).groupby("system", sort=False):
        timed = part.dropna(subset=["ns, banded"])
        time, low, _ = exponent(timed["d"], timed["ns, banded"])
        found.append((name, time, low, exponent(part["d"], part["kB, banded"])[0]))
    return pd.DataFrame(found, columns=["system", "time", "low", "memory"]).dropna()


@of(TABLE)
def scaling(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether time and memory of banded Newton grow no faster than the number d of degrees of freedom.

    None if there are too few sizes.
    """
    found = _exponents(rows)
    if found.empty:
        return None
    steep = [f"time of {r.system}: d^{r.time:.2f}" for r in found.itertuples() if r.low > 1 + ABOVE]
    steep += [f"memory of {r.system}: d^{r.memory:.2f}" for r in found.itertuples() if r.memory > 1 + ABOVE]
    total = 2 * len(found)
    return Verdict(
        "Time and memory in the band grow no faster than the lattice",
        Count(total - len(steep), total),
        EVERY,
        "exponents",
        join_list(steep, 3) if steep else "",
    )


@of(TABLE)
def where_it_contracts(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether banded Newton is never the faster solver at steps at which the fixed-point iteration contracts."""
    short = rows[rows["step"] == "short"].dropna(subset=["banded / usual"])
    sooner = short[short["banded / usual, high"] < 1]
    return Verdict(
        "Where the fixed point contracts, the band is nowhere faster",
        Count(len(sooner), len(short)),
        NONE,
        "cases",
        _places(sooner),
    )


@of(TABLE)
def answer(rows: pd.DataFrame) -> str | None:
    """Write the page's answer, a sentence: banded Newton's time over the usual solver's, at long and at short steps.

    None if one of the two is not timed.
    """
    parts = [rows[rows["step"] == step]["banded / usual"].dropna() for step in ("long", "short")]
    if any(part.empty for part in parts):
        return None
    long, short = (f"{number(part.min(), 2)} to {number(part.max(), 2)}" for part in parts)
    text = f"Implicit lattice steps too long for fixed-point iteration take banded Newton {long} of the time of full"
    return f"{text} matrices; shorter steps {short} times that of fixed-point iteration."


@of(TABLE)
def table(rows: pd.DataFrame) -> Table:
    """Make the page's table: times and memory of both solvers for each lattice and step, at the sizes in `SHOWN`."""
    columns = ["system", "d", "h", "by", "ns, usual", "ns, banded", "banded / usual", "banded / usual, low"]
    columns += ["banded / usual, high", "evaluations, usual", "evaluations, banded", "kB, usual", "kB, banded"]
    caption = (
        "Nanoseconds of a step, medians; `by`: what the usual solver solved the step by; evaluations of the gradient "
        f"or field in a step, a mean over the first {FEW}; memory of the arrays that a run holds."
    )
    return Table(rows[rows["d"].isin(SHOWN)].reindex(columns=columns).head(ROWS), caption)


@of(TABLE)
def full_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the page's longer table: a row for each lattice, size and step size, with both solvers.

    It has times with intervals, the distance of the end states, and the seconds to find the band.
    """
    return rows


def _steps() -> str:
    """Write the two step sizes of each lattice as text."""
    return "; ".join(f"{name}: h = {s.short:g} and {s.long:g}" for name, s in LATTICES.items())


PAGE = Page(
    id="large-solvers",
    question="How are the implicit steps of a lattice solved?",
    tables=(TABLE,),
    setting=(
        f"The implicit midpoint rule ({METHOD}) on stiff springs (fpu), Toda's ring and the Schrödinger ring (nls) "
        "of the page on [many degrees of freedom](large.md).",
        f"Each at a step at which fixed-point iteration contracts, and at one that is too long for it: {_steps()}.",
        "Usual solver: fixed-point iteration from an extrapolated start; where it fails, Newton's method with full "
        f"matrices by differences, timed to d = {FULL}.",
        'Banded (`solver="banded"`): simplified Newton in the order of Cuthill and McKee, which folds a ring; a matrix '
        "by as many differences as the band has colours, kept from step to step until it converges badly.",
        "Both to round-off, run in turns, after compilation, without output.",
    ),
    verdicts=(solves, same, faster, scaling, where_it_contracts),
    answer=answer,
    table=table,
    whole=full_table,
    limits=(
        f"Times are of runs of some milliseconds from the same start, at least {FEWEST} steps, {ROUNDS} rounds: for "
        "the longest lattices few steps, the first of which makes the matrix.",
        "The structure of the band is found once for a system, before a run; its seconds are in the CSV, not in a "
        "step's.",
        f"Exponents are slopes of logarithms from few sizes; they may be above 1 by {ABOVE:g}, because of caches. "
        f"Ends count as the same within {SAME:g} of the state; they are compared after {FEW} steps.",
        "Memory is that of the arrays a run holds; of an array that is never written the operating system gives none, "
        "so that a full matrix costs only where it is used.",
    ),
    command="pytest benchmarks/experiments/large",
)
