"""The report's page "trade": the fastest integrator at each accuracy, for every scene.

A scene is a problem, end time and quantity; a case is a scene at an accuracy.  ``rows`` has a row for each case, with
the fastest of this project's methods and of the peers (other packages' integrators).
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks.ladder.race import KEEP, LOSING, PREPARING
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Range, Verdict, at_least, at_most
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID

from . import again, figures
from .choice import HALF, SHOWN, TIE, at, choices, counts, winner
from .field import SMALL, UNKNOWNS
from .front import CHOICES, FARTHEST, FINALISTS, FINALS, MARGIN
from .settled import LEVEL, TIMES, agreement, coverage, of_choices

if TYPE_CHECKING:
    from pathlib import Path

#: Smallest share of cases in which two sweeps should have the same winner or tied ones.
AGREED = 0.95
#: Smallest share of a third sweep's times and ratios that should lie in the intervals.
HELD = 0.9
#: Largest ratio of our time to a peer's that does not count as far behind.
FAR = 2.0
#: The first scene of each problem, which stands for it in the table.
ONE_EACH = {q.problem.partition(":")[0]: q.id for q in reversed(QUESTIONS)}.values()


@of_choices()
def wins(rows: pd.DataFrame) -> Verdict:
    """Judge whether this project's methods are the fastest in at least half of the cases that are not tied.

    A case is a row: a scene at an accuracy.
    """
    found = choices(rows)
    ours, peers, _, _ = counts(found)
    lost = [_case(row) for _, row in found[found["cheaper"] == PEERS].iterrows()]
    return Verdict(
        "This project's methods are the fastest at least as often as the peers",
        Count(ours, ours + peers),
        at_least(HALF),
        "cases that one side wins",
        where=join_list(lost, 3) if lost else "",
    )


def _case(row: pd.Series) -> str:
    return f"{row['scene']} to {row['accuracy']:g}"


@of_choices()
def farthest(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether no peer (another package's integrator) is more than `FAR` times as fast as this project's best.

    Rows in which the energy is asked and the faster method preserves it by construction do not count.
    """
    found = choices(rows)
    found = found[found["cheaper"].isin([OURS, PEERS])].copy()
    found.loc[found["ratio"].isna() & (found["cheaper"] == PEERS), "ratio"] = np.inf  # only a peer reaches the error
    found = found[found["ratio"].notna()]
    found = found[[not _by_construction(row) for _, row in found.iterrows()]]
    if found.empty:
        return None
    worst = found.loc[found["ratio"].idxmax()]
    return Verdict(
        "This project's fastest method is nowhere far behind the fastest peer",
        Range(found["ratio"].min(), worst["ratio"]),
        at_most(FAR),
        "times the peer's time",
        where=f"{_case(worst)}: {worst[f'{OURS} integrator']} and {worst[f'{PEERS} integrator']}",
    )


def _by_construction(row: pd.Series) -> bool:
    """Return True if a row asks for the energy and the faster method preserves it by construction.

    Such a method has no energy error even on a wrong orbit.
    """
    id = str(row[f"{row['cheaper']} integrator"]).partition("(")[0]
    return row["quantity"] == "energy" and id in BY_ID and BY_ID[id].energy == ROUND_OFF


@of_choices()
def scenes_with_rows(rows: pd.DataFrame) -> Verdict:
    """Judge whether every scene (a problem, end time and quantity) was measured."""
    left = [q.id for q in QUESTIONS if q.id not in set(rows["scene"])]
    return Verdict(
        "Every scene was measured",
        Count(len(QUESTIONS) - len(left), len(QUESTIONS)),
        EVERY,
        "scenes",
        where=f"without {join_list(left)}" if left else "",
    )


@of(FINALS, TIMES, again.TABLE)
def twice(finals: pd.DataFrame, times: pd.DataFrame, second: pd.DataFrame) -> Verdict:
    """Judge whether a repeated measurement finds the same fastest integrators, or ones tied with them.

    ``finals`` and ``second``, of the measurement and its repetition, have a row for each integrator timed in a scene at
    an accuracy; ``times`` has the later timings of those of the first.
    """
    found = agreement(finals, times, second)
    return Verdict(
        "The sweep made again names the same fastest integrator, or a tied one",
        Count(found.same + found.tied, found.pairs),
        at_least(AGREED),
        "cases",
        where=join_list(found.apart, 3) if found.apart else "",
        otherwise=FAIL,
    )


@of(FINALS, TIMES)
def intervals(finals: pd.DataFrame, times: pd.DataFrame) -> Verdict | None:
    """Judge whether the intervals from two timings contain the times, and ratios of times, of a third timing.

    ``finals`` has the first timing of every finalist, ``times`` the later ones; None if there is no third timing.
    """
    shares = {what: inside / total for what, (inside, total) in coverage(finals, times).items() if total}
    if not shares:
        return None
    return Verdict(
        "The intervals from two sweeps hold the times and ratios of a third",
        Range(min(shares.values()), max(shares.values())),
        at_least(HELD),
        "of them",
        where=min(shares, key=shares.get),
        otherwise=FAIL,
    )


@of_choices()
def answer(rows: pd.DataFrame) -> str:
    """Return the page's answer, a sentence: how often our methods, and other packages, are the fastest.

    It names the method of ours that wins most often.
    """
    found = choices(rows)
    ours, peers, tied, _ = counts(found)
    names = Counter(winner(row) for row in found[found["cheaper"] == OURS].to_dict("records"))
    often = f" (most often {names.most_common(1)[0][0]})" if names else ""
    return (
        f"Over {found['scene'].nunique()} scenes at errors from {found['accuracy'].max():g} to "
        f"{found['accuracy'].min():g}, phasebench's integrators{often} are the fastest in {ours} of {len(found)} "
        f"cases, other packages in {peers}; {tied} tie."
    )


@of_choices()
def draw(rows: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the ratio of our best time to the best peer's for every scene and accuracy; save it in ``folder``."""
    return [figures.ratios(choices(rows), folder)]


@of_choices()
def table(rows: pd.DataFrame) -> Table | None:
    """Return the page's table: the fastest integrator at each accuracy of `SHOWN`, for one scene of each problem."""
    found = choices(rows)
    lines = []
    for scene in ONE_EACH:
        part = found[found["scene"] == scene]
        if part.empty:
            continue
        line = {"scene": f"[{scene}](trade-{scene}.md)", "wanted": part["quantity"].iloc[0]}
        lines.append(line | {f"to {a:g}": _cell(at(part, a)) for a in SHOWN})
    if not lines:
        return None
    caption = (
        "The fastest integrator at each error. In brackets: the time of this project's best method divided by the "
        f"best peer's (below 1 we are faster); = marks a tie (the ratio's interval comes within a factor {TIE} of "
        f"1), alone that only one side reaches the error. One scene of a problem, {ROWS} at most; every scene has a page."
    )
    return Table(pd.DataFrame(lines[::-1][:ROWS]), caption)


def _cell(part: pd.DataFrame) -> str:
    """Return a table entry: the fastest integrator of a scene at an accuracy, and our time over the best peer's.

    ``part`` has the row of the scene at the accuracy, or none.
    """
    if part.empty:
        return ""
    row = part.iloc[0]
    if row["cheaper"] == NONE:
        return "none"
    ratio = number(row["ratio"], 2) if pd.notna(row["ratio"]) else "alone"
    return f"{winner(row)} ({'= ' if row['cheaper'] == TIED else ''}{ratio})"


@of_choices()
def _full_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the page's long table: for every scene and accuracy, the fastest integrator of ours and of the peers."""
    found = choices(rows)
    sides = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "h", "tol", "error", "seconds")]
    columns = ["scene", "quantity", "accuracy", *sides, "ratio", "ratio low", "ratio high", "cheaper"]
    return found.reindex(columns=columns)


PAGE = Page(
    id="trade",
    question="Which integrator is the cheapest for a given accuracy?",
    tables=(CHOICES, FINALS, TIMES, again.TABLE),
    setting=(
        f"{len(QUESTIONS)} scenes over every problem: initial data, a time span, a quantity (a state, a phase, the "
        "energy, ...) and its allowed error, 0.1 to 1e-13. A case is a scene and an error. Errors are taken against "
        "certified solutions or long double Taylor series: of states in max norm, of energies over the sizes of H's "
        "terms.",
        "Each integrator is run from the widest step (or loosest tolerance) that works down to round-off, and "
        f"dropped once it takes more than {KEEP:g} times the shortest time known at its error at {LOSING} steps in a "
        "row without coming nearer (data/front_dropped.csv).",
        f"At each error at most {FINALISTS} integrators of a side, within a factor {MARGIN:g} of its fastest, get "
        "their largest sufficient step and are timed in turns: warm, without output, a reset and the integrator's "
        "own call. Whole sweeps are repeated later.",
        "Peers at their best: heyoka's own models and translated equations, high_accuracy and compact_mode on and "
        "off, tolerances to the machine epsilon; SciPy's DOP853, LSODA and Radau with compiled right-hand sides, "
        "ode and odeint; Boost.odeint in C++ by the flags of the bare C loop, and pynamicalsys.",
        "REBOUND: safe_mode 0 and extra forces compiled to C; every corrector, kernel and system of coordinates of "
        "WHFast, IAS15 in four adaptive modes down to the least epsilon, SABA, leapfrog, JANUS, EOS, BS.",
    ),
    verdicts=(wins, scenes_with_rows, farthest, twice, intervals),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        "Left out: heyoka-batch, which carries the same orbit in every lane (a throughput, not the time of one "
        "orbit); SciPy with a Python right-hand side; heyoka's parallel_mode, since everything runs on one core.",
        f"Above {SMALL} degrees of freedom only this project's explicit, one-stage, Gauss and relaxation methods "
        f"compete: the others take minutes to compile there. Gauss methods of more than {UNKNOWNS} unknowns a step, "
        "which take minutes to run, are left out, too.",
        f"heyoka is searched in compact_mode and without it, as far as a tolerance compiles in {PREPARING:g} s. It is "
        "timed in both modes, however long they compile.",
        f"Beyond some {FARTHEST / 30:.0f} revolutions SciPy's solvers whose loop over steps is Python's do not "
        "compete, since nothing can stop them; ode and odeint do.",
        "The step is the largest found between the last one that misses the error and the next; a larger one at "
        "which the error happens to vanish does not count.",
        "An integrator that is exact on a problem does not compete there: Wisdom-Holman on pure Kepler motion, "
        "trigonometric methods on the harmonic oscillator. One that keeps the energy by construction does not count as "
        "far behind or ahead where the energy is asked; it counts among the fastest.",
        "On chaotic orbits an average and an exponent have a statistical uncertainty, stated on the scene's page; "
        "errors below the reference's uncertainty are not asked.",
        f"Swept again, from the beginning: {join_list(again.scenes(), again.COUNT)}, drawn with seed {again.SEED} from "
        f"the {len(again.CHEAP)} scenes that take some 15 s. The slow scenes were not repeated.",
        f"An interval is where a further sweep's median lies in {100 * LEVEL:.0f} % of the cases, judged by how far "
        "two sweeps differ for runs of about the same length (below 25 µs, below 100 µs, longer).",
        "A peer is dropped only by comparison with peers, a method of this project only with such methods.",
        f"Every scene has a page: {', '.join(f'[{q.id}](trade-{q.id}.md)' for q in QUESTIONS)}.",
    ),
    command="pytest benchmarks/experiments/trade",
)
