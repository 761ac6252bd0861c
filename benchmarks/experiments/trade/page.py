"""Which integrator for which accuracy: every scene at a glance."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import Page, Picture, Table, Verdict, of
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import BY_ID
from phasebench.reference.solvers.taylor import COMPACT

from . import again, figures, front
from .choice import SHOWN, TIE, agreement, at, choices, counts, winner
from .climb import KEEP, LOSING, PREPARING
from .field import SMALL, UNKNOWNS
from .front import CHOICES, FARTHEST, FINALISTS, FINALS, MARGIN, UNROLLED
from .settled import LEVEL, TIMES, coverage, of_choices

#: How often two sweeps should agree.
AGREED = 0.95
#: How often the interval of a time, or of a ratio, should hold a further sweep.
HELD = 0.9
#: A peer is farther ahead than this where our methods have something to learn.
FAR = 2.0
#: The question that stands for its problem in the table: the first.
ONE_EACH = {q.problem.partition(":")[0]: q.id for q in reversed(QUESTIONS)}.values()


@of_choices()
def wins(rows: pd.DataFrame) -> Verdict | None:
    """Who is the cheaper how often, at each of the accuracies shown."""
    found = choices(rows)
    parts, total = [], counts(found)
    for accuracy in SHOWN:
        ours, peers, tied, none = counts(at(found, accuracy))
        if ours + peers + tied + none:
            parts.append(f"to {accuracy:g} {ours}:{peers}" + (f" and {_ties(tied)}" if tied else ""))
    if not parts:
        return None
    ours, peers, tied, none = total
    text = f"This project's methods against the peers, scenes in which a side is the cheaper: {'; '.join(parts)}. "
    text += f"Of all {len(found)} pairs of a scene and an accuracy {ours} to {peers}, {_ties(tied)}"
    text += f", {none} reached by none" if none else ""
    return Verdict(f"{text}.", ours >= peers, f"Cheapest: ours {ours}, a peer {peers}, ties {tied} of {len(found)}.")


def _ties(count: int) -> str:
    return f"{count} {'tie' if count == 1 else 'ties'}"


@of_choices()
def farthest(rows: pd.DataFrame) -> Verdict | None:
    """Where the two sides are farthest apart, of errors that an orbit decides."""
    found = choices(rows)
    told = found[found["cheaper"].isin([OURS, PEERS]) & found["ratio"].notna()]
    both = told[[not _by_construction(row) for _, row in told.iterrows()]]
    if both.empty:
        return None
    parts = []
    for who, k, other in ((OURS, both["ratio"].idxmin(), PEERS), (PEERS, both["ratio"].idxmax(), OURS)):
        row = both.loc[k]
        if row["cheaper"] == who:
            share = row["ratio"] if who == OURS else 1 / row["ratio"]
            parts.append(
                f"on {row['scene']} to {row['accuracy']:g} {row[f'{who} integrator']} takes {number(share, 2)} of the time "
                f"of {row[f'{other} integrator']}"
            )
    text = f"Farthest apart: {'; '.join(parts)}"
    text += (
        f" (without {len(told) - len(both)} whose energy is kept by construction)." if len(both) < len(told) else "."
    )
    return Verdict(text, bool(both["ratio"].max() <= FAR), text)


def _by_construction(row: pd.Series) -> bool:
    """Whether the cheaper keeps what is asked, the energy, by construction, whatever its orbit."""
    id = str(row[f"{row['cheaper']} integrator"]).partition("(")[0]
    return row["quantity"] == "energy" and id in BY_ID and BY_ID[id].energy == ROUND_OFF


@of_choices()
def missing(rows: pd.DataFrame) -> Verdict | None:
    """Which scenes were not measured."""
    left = [q.id for q in QUESTIONS if q.id not in set(rows["scene"])]
    if not left:
        return None
    text = f"{len(QUESTIONS) - len(left)} of {len(QUESTIONS)} scenes are measured here; not {listed(left, 10)}."
    return Verdict(text, False, text)


@of(FINALS, again.TABLE)
def twice(finals: pd.DataFrame, second: pd.DataFrame) -> Verdict | None:
    """How often the same sweep, made again, names the same integrator or one that is tied with it."""
    found = agreement(finals, second)
    if not found.pairs:
        return None
    share = (found.same + found.tied) / found.pairs
    text = (
        f"The same sweep made twice ({listed(list(second['scene'].unique()), again.COUNT)}): of {found.pairs} accuracies "
        f"the cheapest was the same integrator in {found.same} and a tie in {found.tied}, together {100 * share:.0f} % "
        f"(wanted: {100 * AGREED:.0f} %)"
    )
    text += f"; another at {listed(found.apart, 3)}." if found.apart else "."
    return Verdict(text, share >= AGREED, f"The same sweep twice: {100 * share:.0f} % the same or a tie.")


@of(FINALS, TIMES)
def intervals(finals: pd.DataFrame, times: pd.DataFrame) -> Verdict | None:
    """How often the intervals of the first two sweeps hold the third."""
    parts, shares = [], []
    for what, (inside, total) in coverage(finals, times).items():
        if total:
            shares.append(inside / total)
            parts.append(f"{inside} of {total} {what} ({100 * inside / total:.0f} %)")
    if not parts:
        return None
    text = f"A third sweep, apart in time, lies in the intervals told of the first two: {', '.join(parts)}"
    short = f"A third sweep lies in the intervals in {100 * min(shares):.0f} % or more."
    return Verdict(f"{text} (wanted: {100 * HELD:.0f} %).", min(shares) >= HELD, short)


@of_choices()
def draw(rows: pd.DataFrame, folder) -> list[Picture]:
    """The ratio of the two sides for every scene and accuracy."""
    return [figures.ratios(choices(rows), folder)]


@of_choices()
def table(rows: pd.DataFrame) -> Table | None:
    """The cheapest of all at four accuracies, one scene of each problem."""
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
        "The cheapest of all for an error up to so much, and in brackets how many times as long the best of this project "
        f"took as the best peer; = where the two are tied (the ratio's interval within a factor {TIE} of 1), the faster "
        "being named. One scene of each problem; every scene has a page."
    )
    return Table(pd.DataFrame(lines[::-1]), caption)


def _cell(part: pd.DataFrame) -> str:
    """What is said of a scene at an accuracy."""
    if part.empty:
        return ""
    row = part.iloc[0]
    if row["cheaper"] == NONE:
        return "none"
    ratio = number(row["ratio"], 2) if pd.notna(row["ratio"]) else "alone"
    return f"{winner(row)} ({'= ' if row['cheaper'] == TIED else ''}{ratio})"


@of_choices()
def _whole(rows: pd.DataFrame) -> pd.DataFrame:
    """Every scene and accuracy."""
    found = choices(rows)
    sides = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "h", "tol", "error", "seconds")]
    columns = ["scene", "quantity", "accuracy", *sides, "ratio", "ratio low", "ratio high", "cheaper"]
    return found.reindex(columns=columns)


PAGE = Page(
    id="trade",
    question="Which integrator is the cheapest for a given accuracy?",
    tables=(CHOICES, FINALS, TIMES, again.TABLE),
    setting=(
        f"{len(QUESTIONS)} scenes over every problem: an orbit, a span, a quantity that is wanted, accuracies from 0.1 to "
        "1e-13. Errors against certified states, or long double Taylor series run at two tolerances.",
        "Everyone climbs from the widest step (or loosest tolerance) that works towards round-off; who takes more than "
        f"{KEEP:g} times the cheapest known at its error on {LOSING} rungs, without coming nearer, is dropped (front_dropped.csv).",
        f"At every accuracy at most {FINALISTS} of each side, within a factor {MARGIN:g} of its best, get their largest step "
        "and are timed in turns by one clock: reset and the integrator's own call, warm, nothing read back, in sweeps apart in time.",
        "Peers at their best: heyoka's own models and translated equations, high_accuracy and compact_mode on and off, "
        "tolerances to the machine epsilon; SciPy's DOP853, LSODA and Radau with compiled right-hand sides, ode and odeint.",
        "REBOUND: safe_mode 0 and extra forces compiled to C; every corrector, kernel and system of coordinates of WHFast, IAS15 in "
        "four adaptive modes down to the least epsilon, SABA, leapfrog, JANUS, EOS, BS.",
    ),
    verdicts=(wins, missing, farthest, twice, intervals),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        "Left out: heyoka-batch, which carries the same orbit in every lane (a throughput, not the time of one orbit); SciPy "
        "with a Python right-hand side; heyoka's parallel_mode, since everything runs on one core.",
        f"Above {SMALL} degrees of freedom explicit, one-stage, Gauss and relaxation methods compete: those that seek a root or "
        "average over a step, that project or need higher derivatives take minutes to compile there (and Gauss methods of more "
        f"than {UNKNOWNS} unknowns a step minutes to run). heyoka climbs there in compact_mode, and without it as far as a "
        f"tolerance compiles in {PREPARING:g} s; below {COMPACT // 2 + 1} the other way around. In the finals it runs in each mode; "
        f"more than {UNROLLED} variables are not unrolled, which takes minutes a tolerance.",
        f"Beyond some {FARTHEST / 30:.0f} revolutions SciPy's solvers whose loops are Python's, which nothing can stop, do not "
        "compete; ode and odeint, whose loops are compiled, do.",
        "A step is the largest found between the last rung that misses an accuracy and the next one; a larger one at which the "
        "error happens to vanish does not count.",
        "Who is exact on a problem does not compete there, being the answer at every accuracy: Wisdom-Holman integrators, ours "
        "and REBOUND's, on the pure Kepler problem, trigonometric ones on the harmonic oscillator.",
        "Of chaotic orbits an average and an exponent have a statistical uncertainty, stated on the scene's page; an accuracy "
        "below the uncertainty of what is true is not asked.",
        f"Twice: {again.COUNT} scenes, drawn with seed {again.SEED} from the {len(again.CHEAP)} that are measured in some 15 "
        "seconds, each from its beginning: climbs, eliminations, finals. Of the dear scenes nothing is said.",
        f"An interval is that in which a further sweep's median lies in {100 * LEVEL:.0f} % of the cases, from how far two "
        "sweeps differ for runs that take about as long (below 25 us, below 100 us, longer).",
        "A peer is dropped only by comparison with peers, a method of this project only with such methods.",
        f"Every scene has a page: {', '.join(f'[{q.id}](trade-{q.id}.md)' for q in QUESTIONS)}.",
    ),
    command="pytest benchmarks/experiments/trade",
)
__all__ = ["PAGE", "front"]
