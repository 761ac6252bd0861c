"""`advise`: the cheapest integration that meets an accuracy, or the most accurate one within a time; run, then said.

What is true of the quantity comes first; what it cannot tell is not advised on.  Then integrators are tried,
the most promising first (`portfolio`), each at the size at which it just meets the accuracy (`search`), until the time
for it is over or the rest was many times dearer wherever it was measured.  The cheapest few run in turns (`finals`); of
those the medians decide.  What is named is run once more against the reference.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np

from phasebench.benchmarks.measure.clock import Sharing
from phasebench.benchmarks.measure.compilation import failure_summary
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.measure.timing import in_turns, median

from . import fewer_bodies, models, words
from .ask import Ask
from .hunt import LONGEST, MIDDLE, Candidate, Search
from .known import KNOWN, known
from .portfolio import Dropped, portfolio
from .search import search
from .trial import Trial

#: Finalists are those within this factor of the cheapest, at most so many, run in turns in so many rounds.
WITHIN, FINALISTS, ROUNDS = 1.6, 6, 9
#: How many more are told of.
ALTERNATIVES = 10
#: Seconds that the final may take.
FINAL = 1.0
#: The reference counts as confirmed where an integrator of another kind comes this near to it, or within the accuracy.
CONFIRMED = 1e-3


def advise(ask: Ask, problem_words: Sequence[str] = (), portfolio_of=portfolio) -> dict[str, Any]:
    """The answer to an ask, as the command prints it; ``problem_words`` name the problem on a command line."""
    began = time.process_time()
    answer: dict[str, Any] = {
        "problem": ask.problem.label,
        "t_end": ask.t_end,
        "quantity": ask.quantity.name,
        "accuracy": ask.accuracy,
        "budget": ask.budget,
        "conserve": list(ask.conserve),
    }
    ask.progress("the reference")
    true, why = known(ask)
    if why:
        return answer | _nothing(why, true)
    search_ = Search(ask, true, began)
    members, search_.dropped = portfolio_of(ask, ask.accuracy or MIDDLE)
    search_.try_all(members)
    if not search_.found:
        return answer | _nothing(_unreached(search_), true, search_.dropped) | _failures(search_)
    order = finals(search_)
    problem_words = list(problem_words) or words.named(ask.problem)
    return answer | _chosen(search_, order, problem_words) | _failures(search_)


def _failures(found: Search) -> dict[str, Any]:
    """Which integrators do not compile, and a warning that says so; null where all of them do."""
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
        "reference": None if true is None else {"uncertainty": true.uncertainty, "source": true.source},
        "verified": False,
    }


def _unreached(found: Search) -> str:
    ask = found.ask
    best = min(
        ((p.error, t) for t in found.trials for p in t.points.values() if p.ok), key=lambda x: x[0], default=None
    )
    if best is None and found.failed and not found.trials:
        return "no integrator that was tried compiles"
    if best is None and not any(t.points for t in found.trials):
        return "no integrator was tried in the time that the search may take: give it more (--limit)"
    if best is None:
        return "no integrator came to the end of the span"
    if ask.budget is not None:
        return f"nothing runs within {ask.budget:g} s"
    kept_ = f" and keeps {', '.join(ask.conserve)}" if ask.conserve else ""
    return (
        f"nothing that was tried meets {ask.accuracy:g}{kept_}: the least error was {best[0]:.2g}, of "
        f"{best[1].integrator.label}; doubles round at {np.finfo(float).eps:.1g} in each operation"
    )


def finals(found: Search) -> list[Candidate]:
    """The candidates by time, or by error where a time was given; the first few run in turns, medians decide."""
    if found.ask.budget is not None:
        return sorted(found.found, key=lambda c: c.point.error)
    order = sorted(found.found, key=lambda c: c.seconds)
    near = [c for c in order if c.seconds <= WITHIN * order[0].seconds][:FINALISTS]
    for kind in (True, False):
        near += [c for c in order if (c.integrator.kind == OURS) is kind and c not in near][:1]
    rounds = int(min(max(FINAL / sum(max(c.seconds, 1e-4) for c in near), 2), ROUNDS))
    found.ask.progress(f"{len(near)} in turns")
    for candidate, seconds in in_turns({c: c for c in near}, rounds).items():
        candidate.seconds = median(seconds).value
    return sorted(near, key=lambda c: c.seconds) + [c for c in order if c not in near]


def _chosen(found: Search, order: list[Candidate], problem_words: Sequence[str]) -> dict[str, Any]:
    ask = found.ask
    own = next((c for c in order if c.integrator.kind == OURS), None)
    peer = next((c for c in order if c.integrator.kind != OURS), None)
    named = list(dict.fromkeys(c for c in (order[0], own, peer, *order[1:2]) if c is not None))
    ask.progress("running what is recommended once more")
    again = {c: _again(c) for c in named}
    rows = {c: c.row(ask, problem_words) | ({"error": again[c]} if c in again else {}) for c in order}
    second = _second(found)
    first = order[0]
    good = ask.accuracy is None or first.trial.meets(first.point._replace(error=again[first]), ask.accuracy)
    confirmed = found.ask.quantity.kept or second["confirmed"]
    return {
        "choice": rows[order[0]],
        "why": "",
        "own": rows.get(own),
        "peer": rows.get(peer),
        "runner_up": rows[order[1]] if len(order) > 1 else None,
        "next": _tenfold(found, order, problem_words) if ask.accuracy is not None else None,
        "lower_model": models.lower(ask) or fewer_bodies.lower(ask, found.true, first),
        "alternatives": [rows[c] for c in order[1 : ALTERNATIVES + 1]],
        "dropped": [d._asdict() for d in found.dropped],
        "shared": sharing(order),
        "reference": {"uncertainty": found.true.uncertainty, "source": found.true.source} | second,
        "verified": bool(good and confirmed),
    }


def sharing(order: Sequence[Candidate]) -> str:
    """What to know of the times where other processes shared the core; empty where none did."""
    every = [c.trial.sharing for c in order]
    together = Sharing(*(sum(getattr(s, name) for s in every) for name in ("readings", "repeated", "disturbed")))
    return together.told()


def _again(candidate: Candidate) -> float:
    """The error of one more run."""
    trial = candidate.trial
    size = next(iter(candidate.point.size.values()))
    fresh = Trial(trial.integrator, trial.ask, trial.true, inf)
    return fresh.error(size)


def _second(found: Search) -> dict[str, Any]:
    """The integrator of another kind than the reference's that came nearest to it."""
    others = [t for t in found.trials if t.integrator.kind != "heyoka"]
    nearest = min(((p.error, t.integrator.id) for t in others for p in t.points.values() if p.ok), default=(inf, None))
    size = float(np.abs(found.true.values).max())
    near = max(found.ask.accuracy or 0.0, CONFIRMED * size)
    return {"second": nearest[1], "distance": nearest[0], "confirmed": bool(nearest[0] <= near)}


def _tenfold(found: Search, order: list[Candidate], problem_words: Sequence[str]) -> dict[str, Any] | None:
    """What the next ten times in accuracy costs, of the first few of the candidates."""
    accuracy, best = found.ask.accuracy / 10, None
    if found.true.uncertainty > KNOWN * accuracy:
        return None
    for candidate in order[:FINALISTS]:
        if found.over(0.95):
            break
        trial, cheapest = candidate.trial, best.seconds if best else inf
        trial.longest = max(trial.longest, LONGEST * LONGEST * candidate.seconds)
        start = next(iter(candidate.point.size.values()))
        result = search(trial, accuracy, start, cheapest)
        if result.point is not None and result.point.seconds < cheapest:
            best = Candidate(trial, result.point)
    return None if best is None else best.row(found.ask, problem_words) | {"accuracy": accuracy}
