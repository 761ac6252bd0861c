"""`advise`: the cheapest integration that meets an accuracy, or the most accurate one within a time, found by running.

First the true value of the quantity is computed; if it is not known well enough for the accuracy, nothing is advised.
Then integrators are tried, the most promising first (`portfolio`), each at the step or tolerance at which it just meets
the accuracy (`search`), until the time for the search is up or all that are left were many times slower in stored
measurements.
The cheapest few are timed again in turns and ranked by median (`finals`).  The recommended ones are run once more
against the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Any

import numpy as np

from phasebench.benchmarks.ladder.race import rounds
from phasebench.benchmarks.ladder.search import search
from phasebench.benchmarks.ladder.trial import Trial
from phasebench.benchmarks.measure.clock import Sharing
from phasebench.benchmarks.measure.compilation import failure_summary
from phasebench.benchmarks.measure.conservation_claims import ENERGY, EPS, SYMPLECTIC
from phasebench.benchmarks.measure.integrator import OURS, Integrator, integrator
from phasebench.benchmarks.measure.quantities import END_STATE, TRAJECTORY, Truth
from phasebench.benchmarks.measure.timing import in_turns, median
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.driver import OK
from phasebench.integrators.systems import singularities
from phasebench.reference.solvers.watch import TooLong, watching

from . import fewer_bodies, models, words
from .ask import Ask
from .deadline import TimeUp, deadline
from .hunt import LONGEST, MIDDLE, Candidate, Search
from .known import KNOWN, true_value
from .portfolio import FIRST, Dropped, portfolio

#: Finalists are within the factor WITHIN of the cheapest, at most FINALISTS; ROUNDS are the fewest and most rounds.
WITHIN, FINALISTS, ROUNDS = 1.6, 6, (2, 9)
#: The most alternatives listed besides the choice.
ALTERNATIVES = 10
#: Seconds that timing the finalists may take.
FINAL = 1.0
#: An end-state error above this share of the initial state's size is worth a note.
LOST = 0.01
#: The reference is confirmed if an integrator of another kind comes within this share of its size, or the accuracy.
CONFIRMED = 1e-3
#: The integrator that is run to confirm the reference if none of another kind did; it needs no compilation.
SECOND = "scipy-dop853"


def advise(
    ask: Ask,
    problem_words: Sequence[str] = (),
    portfolio_of: Callable[[Ask, float], tuple[list[tuple[Integrator, float]], list[Dropped]]] = portfolio,
) -> dict[str, Any]:
    """Search for the integration that answers a question; return the answer, the dict that --json prints.

    ``problem_words`` name the problem on a command line, by default made from it; ``portfolio_of`` is as `portfolio`.
    """
    answer: dict[str, Any] = {
        "problem": ask.problem.label,
        "t_end": ask.t_end,
        "quantity": ask.quantity.name,
        "accuracy": ask.accuracy,
        "budget": ask.budget,
        "conserve": list(ask.conserve),
    }
    ask.progress("the reference")
    try:
        with deadline(ask.left), watching(ask.left, ask.progress):
            true, why = true_value(ask)
    except (TimeUp, TooLong) as late:
        why = ": ".join(filter(None, ("the reference was not finished within the time limit", str(late))))
        return answer | _nothing(why, None) | {"incomplete": True}
    if why:
        return answer | _nothing(why, true)
    search_ = Search(ask, true)
    members, search_.dropped = portfolio_of(ask, ask.accuracy or MIDDLE)
    search_.try_all(members)
    if not search_.found:
        nothing = _nothing(_explain_unreached(search_), true, search_.dropped)
        return answer | nothing | {"incomplete": bool(search_.unfinished)} | _failures(search_)
    fastest = sorted(search_.found, key=lambda c: c.seconds if ask.budget is None else c.rung.error)
    order = _in_time(search_, "timing the best in turns", lambda: finals(search_), fastest)
    problem_words = list(problem_words) or words.problem_arguments(ask.problem)
    return answer | _recommendation(search_, order, problem_words) | _failures(search_)


def _in_time(found: Search, what: str, make: Callable[[], Any], instead: Any) -> Any:
    """``make()``; if too little time is left for it, ``what`` is noted as unfinished, and it is ``instead``."""
    try:
        with deadline(found.ask.left):
            return make()
    except TimeUp:
        found.unfinished.append(what)
        return instead


def _failures(found: Search) -> dict[str, Any]:
    return {
        "failed": [f._asdict() for f in found.failed],
        "warning": failure_summary(found.failed, found.all_own_failed) or None,
    }


def _nothing(why: str, true: Truth | None, dropped: Sequence[Dropped] = ()) -> dict[str, Any]:
    return {
        "choice": None,
        "why": why,
        "own": None,
        "peer": None,
        "runner_up": None,
        "next": None,
        "lower_model": None,
        "alternatives": [],
        "dropped": [d._asdict() for d in dropped],
        "failed": [],
        "warning": None,
        "shared": "",
        "notes": [],
        "incomplete": False,
        "reference": None if true is None else {"uncertainty": true.uncertainty, "source": true.source},
        "verified": False,
    }


def _explain_unreached(found: Search) -> str:
    ask = found.ask
    best = min(((r.error, t) for t in found.trials for r in t.rungs.values() if r.ok), key=lambda x: x[0], default=None)
    if best is None and found.failed and not found.trials:
        return "no integrator that was tried compiles"
    if best is None and not any(t.rungs for t in found.trials):
        return "no integrator was tried in the time that the search may take: give it more (--time-limit)"
    if best is None:
        return "no integrator came to the end of the span"
    if ask.budget is not None:
        return f"nothing runs within {ask.budget:g} s"
    kept_ = f" and keeps {', '.join(ask.conserve)}" if ask.conserve else ""
    error, of = best[0], best[1].integrator
    broken = {d.integrator: d.why for d in found.dropped}.get(of.id) if error <= ask.accuracy else None
    if broken:
        least = f"{of.label} has an error of {error:.2g}, but {broken}"
    else:
        least = f"the least error was {error:.2g}, of {of.label}; doubles round at {EPS:.1g} in each operation"
    both = {SYMPLECTIC, ENERGY} <= set(ask.conserve)
    hint = "; in general no method does both (Ge and Marsden, 1988): ask for one of them" if both else ""
    return f"nothing that was tried meets {ask.accuracy:g}{kept_}: {least}{hint}"


def finals(found: Search) -> list[Candidate]:
    """Rank the candidates of a search, the best first: by time or, if a time budget was given, by error.

    The fastest few, one more method of this project and one more peer are first timed again in turns.
    """
    if found.ask.budget is not None:
        return sorted(found.found, key=lambda c: c.rung.error)
    order = sorted(found.found, key=lambda c: c.seconds)
    near = [c for c in order if c.seconds <= WITHIN * order[0].seconds][:FINALISTS]
    for kind in (True, False):
        near += [c for c in order if (c.integrator.kind == OURS) is kind and c not in near][:1]
    found.ask.progress(f"{len(near)} in turns")
    turns = in_turns({c: c for c in near}, rounds((c.seconds for c in near), FINAL, *ROUNDS))
    for candidate, seconds in turns.items():
        told = median(seconds)
        candidate.seconds, candidate.interval = told.value, (told.low, told.high)
    return sorted(near, key=lambda c: c.seconds) + [c for c in order if c not in near]


def _recommendation(found: Search, order: list[Candidate], problem_words: Sequence[str]) -> dict[str, Any]:
    ask = found.ask
    own = next((c for c in order if c.integrator.kind == OURS), None)
    peer = next((c for c in order if c.integrator.kind != OURS), None)
    named = list(dict.fromkeys(c for c in (order[0], own, peer, *order[1:2]) if c is not None))
    ask.progress("running what is recommended once more")
    again = _in_time(found, "running it again", lambda: {c: c.trial.repeat(c.rung) for c in named}, {})
    rows = {c: c.row(ask, problem_words) | ({"error": again[c]} if c in again else {}) for c in order}
    nobody = {"second": None, "distance": None, "confirmed": False}
    second = _in_time(found, "confirming the reference", lambda: _second(found), nobody)
    first = order[0]
    rows[first]["end_state_error"] = off = _in_time(found, "its end state", lambda: end_state_error(first), None)
    for c in order[1:]:
        rows[c]["tie"] = tied(first, c)
    repeated = first.rung._replace(error=again.get(first, inf))
    good = first in again and (ask.accuracy is None or first.trial.meets(repeated, ask.accuracy))
    confirmed = found.ask.quantity.kept or second["confirmed"]

    def tenth() -> dict[str, Any] | None:
        return _tenfold(found, order, problem_words) if ask.accuracy is not None else None

    following = _in_time(found, "a tenth of the accuracy", tenth, None)
    lower = _in_time(
        found, "lower models", lambda: models.lower(ask) or fewer_bodies.lower(ask, found.true, first), None
    )
    notes = unfinished(found), lost_orbit(first, off), singularity_note(ask.problem)
    return {
        "choice": rows[order[0]],
        "why": "",
        "own": rows.get(own),
        "peer": rows.get(peer),
        "runner_up": rows[order[1]] if len(order) > 1 else None,
        "next": following,
        "lower_model": lower,
        "alternatives": [rows[c] for c in order[1 : ALTERNATIVES + 1]],
        "dropped": [d._asdict() for d in found.dropped],
        "shared": sharing(order),
        "notes": [note for note in notes if note],
        "incomplete": bool(found.unfinished),
        "reference": {"uncertainty": found.true.uncertainty, "source": found.true.source} | second,
        "verified": bool(good and confirmed),
    }


def unfinished(found: Search) -> str:
    """A note of what the time limit left out that could have changed the answer; "" if nothing."""
    if not found.unfinished:
        return ""
    return f"incomplete: {found.ask.limit:g} s (--time-limit) ended before {', '.join(found.unfinished)}"


def tied(first: Candidate, other: Candidate) -> bool:
    """True if the times of two candidates timed in turns cannot be told apart: their intervals overlap."""
    if first.interval is None or other.interval is None:
        return False
    return other.interval[0] <= first.interval[1] and first.interval[0] <= other.interval[1]


def end_state_error(candidate: Candidate) -> float | None:
    """Distance (max norm over q and p) of a candidate's end state from that of heyoka, an accurate Taylor integrator.

    None if the quantity is of whole states or statistical, heyoka cannot run the problem, or a run fails.
    """
    task, heyoka = candidate.trial.task, integrator(FIRST)
    if task.quantity in (END_STATE, TRAJECTORY) or task.quantity.statistical or heyoka.lacks(task.problem):
        return None
    one = task.run(candidate.integrator, candidate.rung.size, bare=True)
    other = heyoka.run(task.problem, t_end=task.t_end, save_every=0)
    if one.status != OK or other.status != OK:
        return None
    return float(max(np.abs(one.q[-1] - other.q[-1]).max(), np.abs(one.p[-1] - other.p[-1]).max()))


def lost_orbit(candidate: Candidate, off: float | None) -> str:
    """A note that the orbit is wrong (its end state by ``off``) although the quantity is accurate; else ""."""
    made = candidate.trial.task.problem
    size = max(map(abs, (*made.q0, *made.p0)))
    if off is None or off <= LOST * size:
        return ""
    return (
        f"{candidate.trial.task.quantity.name} alone was asked for: the end state is off by {off:.2g}, and the initial "
        f"state is of size {size:.2g}; ask for --quantity end-state if the orbit matters"
    )


def singularity_note(problem: Problem) -> str:
    """A note that the singularities of H were not searched for, as a denominator of it is too long; else ""."""
    if not singularities.unsearched(problem.system):
        return ""
    return "H has too long a denominator for singular distances to be found in it; declare them with singular="


def sharing(order: Sequence[Candidate]) -> str:
    """A note that other processes shared the core while times were measured; "" if none did."""
    every = [c.trial.task.clocks.sharing for c in order]
    together = Sharing(*(sum(getattr(s, name) for s in every) for name in ("readings", "repeated", "disturbed")))
    return together.summary()


def _second(found: Search) -> dict[str, Any]:
    """The reference confirmed, or not, by a run of another integrator: its id, how near it comes, and whether that is
    near.

    If none of the runs of the search does, the integrator `SECOND` is run as well.
    """
    near = max(found.ask.accuracy or 0.0, CONFIRMED * float(np.abs(found.true.values).max()))
    others = [t for t in found.trials if t.integrator.kind != "heyoka"]
    nearest = _nearest(others)
    if nearest[0] > near and not (second := integrator(SECOND)).lacks(found.ask.problem):
        trial, tol = Trial(second, found.task(), FINAL), near / 100
        if not found.ask.quantity.kept and trial.pilot(tol) <= FINAL:
            trial.at(tol)
        nearest = min(nearest, _nearest([trial]), key=lambda x: x[0])
    return {"second": nearest[1], "distance": nearest[0], "confirmed": bool(nearest[0] <= near)}


def _nearest(trials: Sequence[Trial]) -> tuple[float, str | None]:
    ended = ((r.error, t.integrator.id) for t in trials for r in t.rungs.values() if r.ok)
    return min(ended, key=lambda x: x[0], default=(inf, None))


def _tenfold(found: Search, order: list[Candidate], problem_words: Sequence[str]) -> dict[str, Any] | None:
    """The cheapest run at a tenth of the accuracy by one of the first few candidates, as a row, or None."""
    accuracy, best = found.ask.accuracy / 10, None
    if found.true.uncertainty > KNOWN * accuracy:
        return None
    for candidate in order[:FINALISTS]:
        if found.over(0.95):
            break
        trial, cheapest = candidate.trial, best.seconds if best else inf
        trial.longest = max(trial.longest, LONGEST * LONGEST * candidate.seconds)
        result = search(trial, accuracy, candidate.rung.number, cheapest)
        if result.rung is not None and result.rung.seconds < cheapest:
            best = Candidate(trial, result.rung)
    return None if best is None else best.row(found.ask, problem_words) | {"accuracy": accuracy}
