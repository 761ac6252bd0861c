"""How the implicit steps of a lattice are solved: the page."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Table, Verdict, of

from .large import exponent
from .page import ABOVE
from .solvers import FEW, FEWEST, FULL, LATTICES, METHOD, ROUNDS, TABLE

#: The ends of a few steps are the same where they are apart by less than this share of the state.
SAME = 1e-12
#: The sizes of the table.
SHOWN = (32, 128, 2048, 10_000)


def _at(row) -> str:
    return f"{row['system']}, d = {int(row['d'])}"


def _range(part: pd.DataFrame, column: str) -> str:
    low, high = (part.loc[getattr(part[column], f)()] for f in ("idxmin", "idxmax"))
    return f"{number(low[column], 2)} ({_at(low)}) to {number(high[column], 2)} ({_at(high)})"


@of(TABLE)
def solves(rows: pd.DataFrame) -> Verdict | None:
    """Whether steps that are too long for the fixed point are solved in the band, and for how much less."""
    long = rows[rows["step"] == "long"]
    if long.empty:
        return None
    lost = long[~long["solved, banded"].astype(bool)]
    if len(lost):
        where = "; ".join(_at(r) for r in lost.to_dict("records"))
        return Verdict(f"Newton's method in the band does not solve the long steps of {where}.", False, "Not solved.")
    both = long.dropna(subset=["banded / usual"])
    text = (
        f"Newton's method in the band solves the steps that are too long for the fixed point to d = {long['d'].max()}"
    )
    if both.empty:
        return Verdict(f"{text}; nothing is beside it.", False, "The band has nothing beside it.")
    text += f"; it takes {_range(both, 'banded / usual')} of the time with full matrices"
    together = rows["apart"].dropna()
    text += f", and ends as they do, to {number(together.max(), 2)} of the state in {FEW} steps"
    holds = bool((both["banded / usual, high"] < 1).all() and together.max() <= SAME)
    return Verdict(
        f"{text}.", holds, f"In the band a long step takes at most {number(both['banded / usual'].max(), 2)}."
    )


@of(TABLE)
def scaling(rows: pd.DataFrame) -> Verdict | None:
    """How time and memory grow."""
    parts, memory, steep = [], [], []
    for name, part in rows[rows["step"] == "long"].groupby("system", sort=False):
        timed = part.dropna(subset=["ns, banded"])
        e, low, high = exponent(timed["d"], timed["ns, banded"])
        if np.isnan(e):
            continue
        parts.append(f"{name} {e:.2f} [{low:.2f}, {high:.2f}]")
        steep += [name] if low > 1 + ABOVE else []
        memory.append((exponent(part["d"], part["kB, banded"])[0], exponent(part["d"], part["kB, usual"])[0]))
    if not parts:
        return None
    ours, theirs = (max(m[k] for m in memory) for k in (0, 1))
    text = f"A long step in the band costs d to the power {'; '.join(parts)}, its memory d to {ours:.2f} at most"
    text += f" (full matrices: {theirs:.2f})"
    text += f"; steeper than the lattice is long: {', '.join(steep)}" if steep else "; no more than the lattice is long"
    holds = not steep and ours <= 1 + ABOVE
    return Verdict(f"{text}.", holds, f"Steps in the band: d to {', '.join(p.partition(' [')[0] for p in parts)}.")


@of(TABLE)
def where_it_contracts(rows: pd.DataFrame) -> Verdict | None:
    """What the band costs where it is not needed: there the usual solver should be the one to take."""
    short = rows[rows["step"] == "short"].dropna(subset=["banded / usual"])
    if short.empty:
        return None
    text = f"Where the fixed point contracts, the band takes {_range(short, 'banded / usual')} times its time"
    faster = short[short["banded / usual, high"] < 1]
    if faster.empty:
        return Verdict(f"{text}: leave the solver out there.", True, "Short steps: the fixed point.")
    text += f"; it is the faster one at {'; '.join(_at(r) for r in faster.to_dict('records'))}"
    return Verdict(f"{text}.", False, "The band is faster than the fixed point somewhere.")


@of(TABLE)
def table(rows: pd.DataFrame) -> Table:
    """Every row of the sizes `SHOWN`."""
    columns = ["system", "d", "h", "by", "ns, usual", "ns, banded", "banded / usual", "banded / usual, low"]
    columns += ["banded / usual, high", "evaluations, usual", "evaluations, banded", "kB, usual", "kB, banded"]
    caption = (
        "Nanoseconds of a step, medians; what the usual solver solved the step by; evaluations of the gradient or "
        f"field in a step, of the first {FEW}; memory that a run holds."
    )
    return Table(rows[rows["d"].isin(SHOWN)].reindex(columns=columns).head(ROWS), caption)


@of(TABLE)
def whole(rows: pd.DataFrame) -> pd.DataFrame:
    """Every size, with the intervals, the ends' distance, and the seconds in which the structure was found."""
    return rows


def _steps() -> str:
    return "; ".join(f"{name}: h = {s.short:g} and {s.long:g}" for name, s in LATTICES.items())


PAGE = Page(
    id="large-solvers",
    question="How are the implicit steps of a lattice solved?",
    tables=(TABLE,),
    setting=(
        f"The implicit midpoint rule ({METHOD}) on stiff springs (fpu), Toda's ring and the Schroedinger ring of the "
        "page `large`.",
        f"At a step at which the fixed point contracts, and at one that is too long for it: {_steps()}.",
        "Usual: the fixed point from an extrapolated start, where it fails Newton's method with full matrices by "
        f"differences; at long steps to d = {FULL}.",
        'Banded (`solver="banded"`): simplified Newton in the order of Cuthill and McKee, which folds a ring; a matrix '
        "by as many differences as the band has colours, kept from step to step until it serves badly.",
        "Both to round-off, in turns, warm, without output.",
    ),
    verdicts=(solves, scaling, where_it_contracts),
    table=table,
    whole=whole,
    limits=(
        f"A time is of runs from the same start of some milliseconds, of at least {FEWEST} steps, {ROUNDS} rounds: of "
        "the longest lattices few steps, the first of which makes the matrix.",
        "The structure is found once for a system, before a run; the seconds that it takes are in the CSV, not in "
        "those of a step.",
        f"Exponents are slopes of logarithms from few sizes; they may be above 1 by {ABOVE:g}: caches.  Ends are the "
        f"same to {SAME:g} of the state.",
        "Memory is that of the arrays a run holds; of an array that is never written the operating system gives none, "
        "so that a full matrix costs only where it is used.",
    ),
    command="pytest benchmarks/experiments/large",
)
