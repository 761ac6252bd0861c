"""The integrators to try on a problem, in which order, and those that are not tried, with the reason."""

from __future__ import annotations

from typing import NamedTuple

from phasebench.benchmarks.ladder.trial import exact
from phasebench.benchmarks.measure import conservation_claims
from phasebench.benchmarks.measure.integrator import OURS, Integrator
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS

from . import prior
from .ask import Ask

#: Peers that integrate many orbits at once: their time is not that of one orbit.
LANES = ("heyoka-batch",)
#: Kinds of integrators tried first: loops or right-hand sides of other packages run in Python, or compile for seconds.
FIRST_KINDS = (OURS, "heyoka", "rebound", "scipy")
#: The peer tried first: it runs on any problem, and its steps tell how fast the orbit moves.
FIRST = "heyoka"


class Dropped(NamedTuple):
    """An integrator that is not advised, and why."""

    integrator: str
    why: str


def portfolio(ask: Ask, accuracy: float) -> tuple[list[tuple[Integrator, float]], list[Dropped]]:
    """The (integrator, expected time over that of the cheapest) to try, in order, and those that are not tried."""
    able, dropped = [], []
    for record in (*METHODS, *PEERS):
        integrator = Integrator(record)
        why = _refusal(integrator, ask)
        if why:
            dropped.append(Dropped(integrator.id, why))
        else:
            able.append(integrator)
    id = ask.problem.id
    expected = prior.factors(id, accuracy, [i.id for i in able])
    turns = _in_turn([i for i in able if exact(i, ask.problem)])
    expected |= dict.fromkeys(turns, 0.0)  # the measurements behind the prior leave them out
    by_hope = sorted(able, key=lambda i: (i.id != FIRST, i.kind not in FIRST_KINDS, expected[i.id], turns.get(i.id, 0)))
    return [(i, expected[i.id]) for i in by_hope], dropped


def _in_turn(members: list[Integrator]) -> dict[str, int]:
    """Id of an integrator -> its rank among those of its kind: sorted by it, integrators of kinds alternate."""
    kinds: dict[str, list[str]] = {}
    for i in members:
        kinds.setdefault(i.kind, []).append(i.id)
    return {id: place for ids in kinds.values() for place, id in enumerate(ids)}


def _refusal(integrator: Integrator, ask: Ask) -> str | None:
    if integrator.id in LANES:
        return "it integrates many orbits at once; its time is not one orbit's"
    if not integrator.installed:
        return f"{integrator.record.package} is not installed"
    try:
        lack = integrator.lacks(ask.problem)
    except ImportError as error:
        return f"{integrator.kind} cannot be imported ({error})"
    return lack or conservation_claims.refusal(integrator, ask.conserve)
