"""Who is tried, in which order, and who is not and why."""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple

from phasebench.benchmarks.measure.integrator import OURS, Integrator
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS

from . import kept, prior
from .ask import Ask
from .exact import exact

#: The same orbit in every lane: a throughput of many orbits, not the time of one.
LANES = ("heyoka-batch",)
#: Packages whose loops over steps, or whose right-hand sides, are Python's or compile for seconds: they are tried last.
SLOW = ("gala", "galpy", "desolver", "pyhamsys", "diffrax")
#: A peer that runs on anything, and tells how fast the orbit moves: it is tried first.
FIRST = "heyoka"


class Dropped(NamedTuple):
    """An integrator that is not advised, and why."""

    integrator: str
    why: str


def portfolio(ask: Ask, accuracy: float) -> tuple[list[tuple[Integrator, float]], list[Dropped]]:
    """([(integrator, how many times dearer than the cheapest it is to be expected)], those that are not tried)."""
    able, dropped = [], []
    for record in (*METHODS, *PEERS):
        integrator = Integrator(record)
        why = _refused(integrator, ask)
        if why:
            dropped.append(Dropped(integrator.id, why))
        else:
            able.append(integrator)
    id = ask.problem.id
    expected = prior.factors(id, accuracy, [i.id for i in able])
    turns = _in_turn([i for i in able if exact(i, ask.problem)])
    expected |= dict.fromkeys(turns, 0.0)  # the trade, of which the prior is made, leaves them out
    by_hope = sorted(able, key=lambda i: (i.id != FIRST, i.kind in SLOW, expected[i.id], turns.get(i.id, 0)))
    return [(i, expected[i.id]) for i in by_hope], dropped


def _in_turn(members: list[Integrator]) -> dict[str, int]:
    """Integrator -> its place among those of its kind, by which the kinds take turns."""
    kinds: dict[str, list[str]] = {}
    for i in members:
        kinds.setdefault(i.kind, []).append(i.id)
    return {id: place for ids in kinds.values() for place, id in enumerate(ids)}


def _refused(integrator: Integrator, ask: Ask) -> str | None:
    """Why an integrator is not tried."""
    if integrator.id in LANES:
        return "it integrates many orbits at once; its time is not one orbit's"
    if integrator.kind != OURS and not _installed(integrator.record.package):
        return f"{integrator.record.package} is not installed"
    try:
        lack = integrator.lacks(ask.problem)
    except ImportError as error:
        return f"{integrator.kind} cannot be imported ({error})"
    return lack or kept.refused(integrator, ask.conserve)


def _installed(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except ValueError:  # it was taken out of the imported modules
        return False
