"""The fastest integrators at each accuracy, for every scene: the page, and the runs of all pages.

A scene is a problem, end time and quantity; a case is a scene at an accuracy.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.ladder.choice import TIE, winner
from phasebench.benchmarks.ladder.competitors import SMALL, UNKNOWNS
from phasebench.benchmarks.ladder.race import KEEP, LOSING, PREPARING
from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import at_least, at_most
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.benchmarks.store.cells import ALONE
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import METHODS

from . import front
from .front import AGAIN, CHOICES, DROPPED, FARTHEST, FINALISTS, FINALS, MARGIN, RUNGS, TIMES
from .joined import LEVEL, agreement, cases, coverage, joined

#: Smallest share of the decided cases that this project should win; of cases in which two sweeps should have the same
#: winner or tied ones; of a third sweep's times and ratios that should lie in the intervals.
HALF, AGREED, HELD = 0.5, 0.95, 0.9
#: Largest ratio of our time to a peer's that does not count as far behind.
FAR = 2.0
#: The accuracies that are shown side by side; the relative difference up to which two accuracies are equal.
SHOWN, SAME = (1e-3, 1e-6, 1e-9, 1e-12), 1e-6
#: The first scene of each problem, which stands for it in the table.
ONE_EACH = {q.problem.partition(":")[0]: q.id for q in reversed(QUESTIONS)}.values()
#: Methods that preserve the energy by construction.
KEEP_ENERGY = {m.id for m in METHODS if m.energy == ROUND_OFF}
#: Ratio at which colours are saturated.
SATURATED = 8.0
SCENES = tuple(q.id for q in QUESTIONS)


def counts(found: pd.DataFrame) -> tuple[int, int, int]:
    """Numbers of cases: (ours is faster, a peer is, tied)."""
    return tuple(int((found["cheaper"] == who).sum()) for who in (OURS, PEERS, TIED))


def fair(rows: pd.DataFrame) -> pd.Series:
    """True for cases that a side wins, save those that ours alone reaches, or a method that keeps the energy anyway.

    A method that preserves the energy by construction has no energy error even on a wrong orbit.
    """
    fastest = rows[f"{OURS} integrator"].where(rows["cheaper"] == OURS, rows[f"{PEERS} integrator"])
    keeps = fastest.astype(str).str.partition("(")[0].isin(KEEP_ENERGY)
    return rows["cheaper"].isin([OURS, PEERS]) & (rows["ratio"] > 0) & ~(keeps & (rows["quantity"] == "energy"))


MEASURED = Claim(
    "Every scene was measured",
    joined, lambda rows: pd.Series(SCENES, SCENES).isin(rows["scene"]), unit="scenes", names=8,
)  # fmt: skip


@of(joined)
def _answer(found: pd.DataFrame) -> str:
    ours, peers, tied = counts(found)
    names = Counter(winner(row) for row in found[found["cheaper"] == OURS].to_dict("records"))
    often = f" (most often {names.most_common(1)[0][0]})" if names else ""
    return (
        f"Over {found['scene'].nunique()} scenes at errors from {found['accuracy'].max():g} to "
        f"{found['accuracy'].min():g}, phasebench's integrators{often} are the fastest in {ours} of {len(found)} "
        f"cases, other packages in {peers}; {tied} tie."
    )


def _at(found: pd.DataFrame, accuracy: float) -> pd.DataFrame:
    return found[np.isclose(found["accuracy"], accuracy, rtol=SAME, atol=0)]


@picture(cases, "trade", "time of ours over the best peer's")
def _draw(found: pd.DataFrame) -> tuple[style.Figure, str]:
    from matplotlib.colors import LinearSegmentedColormap

    decades = range(1, 14)
    columns = {k: _at(found, 10.0**-k).set_index("scene")["ratio"] for k in decades}
    field = pd.DataFrame(columns, index=found["scene"].unique())
    figure, ((axes,),) = style.panels(1, 1, 1.2 + 0.2 * len(field))
    colours = LinearSegmentedColormap.from_list("sides", [style.BLUE, "#ffffff", style.VERMILION])
    most = np.log2(SATURATED)
    shades = np.log2(field.clip(1 / SATURATED, SATURATED))
    axes.imshow(shades, cmap=colours, vmin=-most, vmax=most, aspect="auto")
    for (i, k), x in np.ndenumerate(field):
        if not np.isnan(x):
            label = {0.0: "ours", np.inf: "peer"}.get(x, style.number(x, 2))
            colour = "white" if abs(shades.iloc[i, k]) > 0.6 * most else "black"
            axes.text(k, i, label, ha="center", va="center", fontsize=8, color=colour)
    axes.set_yticks(range(len(field)), field.index)
    axes.set_xticks(range(len(decades)), [f"1e-{k}" for k in decades])
    axes.xaxis.tick_top()
    axes.set_xlabel("error up to")
    axes.xaxis.set_label_position("top")
    scores = ["{}, {} and {} at {:g}".format(*counts(_at(found, a)), a) for a in SHOWN]
    return figure, (
        "Our best time over the best peer's. Blue: ours is faster; red: a peer; ours or peer: only that side "
        f"reaches the error. Scenes won by ours, by a peer, tied: {'; '.join(scores)}."
    )


def _cell(row: dict) -> str:
    """The fastest integrator of a case, or of none, with our time over the best peer's."""
    if row["cheaper"] == NONE:
        return "none"
    ratio = number(row["ratio"], 2) if pd.notna(row["ratio"]) else "alone"
    return f"{winner(row)} ({'= ' if row['cheaper'] == TIED else ''}{ratio})"


@of(joined)
def _table(found: pd.DataFrame) -> Table | None:
    lines = []
    for scene in ONE_EACH:
        if not (part := found[found["scene"] == scene]).empty:
            cells = {f"to {a:g}": "".join(map(_cell, _at(part, a).to_dict("records"))) for a in SHOWN}
            lines.append({"scene": f"[{scene}](trade-{scene}.md)", "wanted": part["quantity"].iloc[0]} | cells)
    caption = (
        "The fastest integrator at each error. In brackets: the time of this project's best method divided by the "
        f"best peer's (below 1 we are faster); = marks a tie (the ratio's interval comes within a factor {TIE} of 1), "
        f"alone that only one side reaches the error. One scene of a problem, {ROWS} at most; every scene has a page."
    )
    return Table(pd.DataFrame(lines[::-1][:ROWS]), caption) if lines else None


@of(joined)
def _full_table(found: pd.DataFrame) -> pd.DataFrame:
    sides = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "h", "tol", "error", "seconds")]
    columns = ["scene", "quantity", "accuracy", *sides, "ratio", "ratio low", "ratio high", "cheaper"]
    return found.reindex(columns=columns)


def _timed(name: str, measure: object, keys: list, **more: object) -> Runs:
    """A table of times of scenes, by which they are selected."""
    return Runs(name, measure, keys, front.needs, ALONE, own=True, names=front.names, **more)


#: What is checked of the rows of finalists.
SOUND = "error <= accuracy and 0 < low and low <= seconds and seconds <= high"
STUDY = Study(
    id="trade",
    place=10,
    question="Which integrator is the cheapest for a given accuracy?",
    tables=(CHOICES, FINALS, TIMES, AGAIN),
    answer=_answer,
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
    runs=(
        _timed(AGAIN, front.again, over(scene=front.TWICE)),
        _timed(CHOICES, front.measure, over(scene=SCENES), more=(FINALS, RUNGS, DROPPED)),
        _timed(TIMES, front.sweep_again, over(scene=SCENES, sweep=front.SWEEPS)),
    ),
    claims={
        "wins": Claim(
            "This project's methods are the fastest at least as often as the peers",
            joined, f"cheaper == '{OURS}'", at_least(HALF), rows=f"cheaper in ['{OURS}', '{PEERS}']",
            unit="cases that one side wins", where="{scene} to {accuracy:g}", names=3,
        ),
        "scenes": MEASURED,
        "farthest": Claim(
            "This project's fastest method is nowhere far behind the fastest peer",
            cases, "ratio", at_most(FAR), rows=fair, unit="times the peer's time", span=True,
            where="{scene} to {accuracy:g}: {ours integrator} and {peer integrator}",
        ),
        "twice": Claim(
            "The sweep made again names the same fastest integrator, or a tied one",
            of(FINALS, TIMES, AGAIN)(agreement), "agree", at_least(AGREED), unit="cases",
            where="{scene} to {accuracy:g} ({first}, then {second})", names=3, fault=True, whole=True,
        ),
        "intervals": Claim(
            "The intervals from two sweeps hold the times and ratios of a third",
            FINALS, coverage, at_least(HELD), unit="of them", beside=(TIMES,), span=True, fault=True, whole=True,
        ),
    },
    checks={
        "finalists": Claim("Finalists meet their accuracy, their times lie in their intervals", FINALS, SOUND),
        "again": Claim("So do those of the sweep made again", AGAIN, SOUND),
    },
    figure=_draw,
    shown=_table,
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
        f"Swept again, from the beginning: {join_list(front.TWICE, front.COUNT)}, drawn with seed {front.SEED} from "
        f"the {len(front.CHEAP)} scenes that take some 15 s. The slow scenes were not repeated.",
        f"An interval is where a further sweep's median lies in {100 * LEVEL:.0f} % of the cases, judged by how far "
        "two sweeps differ for runs of about the same length (below 25 µs, below 100 µs, longer).",
        "A peer is dropped only by comparison with peers, a method of this project only with such methods.",
        f"Every scene has a page: {', '.join(f'[{q.id}](trade-{q.id}.md)' for q in QUESTIONS)}.",
    ),
)  # fmt: skip
