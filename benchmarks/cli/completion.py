"""Names that the shell completes: ids of problems, methods and peers, without importing what computes with them."""

from __future__ import annotations

from collections.abc import Iterable


def problems(incomplete: str) -> list[str]:
    """The names of problems, and problem:orbit, that begin with the text typed so far."""
    from phasebench.benchmarks.problems import PROBLEMS

    orbits = [f"{name}:{orbit}" for name, (_, _, orbits) in PROBLEMS.items() for orbit in orbits]
    return _matches([*PROBLEMS, *orbits], incomplete)


def methods(incomplete: str) -> list[str]:
    """The ids of methods that begin with the text typed so far."""
    from phasebench.integrators.registry import BY_ID

    return _matches(BY_ID, incomplete)


def peers(incomplete: str) -> list[str]:
    """Return the ids of peers (integrators of other packages) that begin with the text typed so far."""
    from phasebench.reference.peers import BY_ID

    return _matches(BY_ID, incomplete)


def methods_and_peers(incomplete: str) -> list[str]:
    """Return the ids of methods and peers (of other packages) that begin with the text typed so far."""
    return methods(incomplete) + peers(incomplete)


def methods_and_problems(incomplete: str) -> list[str]:
    """Return the names of methods and problems that begin with the text typed so far."""
    return methods(incomplete) + problems(incomplete)


def _matches(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
