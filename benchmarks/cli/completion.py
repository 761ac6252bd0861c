"""Names that the shell completes: ids of problems, methods and peers, without importing what computes with them."""

from __future__ import annotations

from collections.abc import Iterable


def problems(incomplete: str) -> list[str]:
    """Return the problems, and problem:orbit, that begin with the text."""
    from phasebench.benchmarks.problems import PROBLEMS

    orbits = [f"{name}:{orbit}" for name, (_, _, orbits) in PROBLEMS.items() for orbit in orbits]
    return _matches([*PROBLEMS, *orbits], incomplete)


def methods(incomplete: str) -> list[str]:
    """Return the methods that begin with the text."""
    from phasebench.integrators.registry import BY_ID

    return _matches(BY_ID, incomplete)


def peers(incomplete: str) -> list[str]:
    """Return the peers that begin with the text."""
    from phasebench.reference.peers import BY_ID

    return _matches(BY_ID, incomplete)


def methods_and_peers(incomplete: str) -> list[str]:
    """Return the methods and peers that begin with the text."""
    return methods(incomplete) + peers(incomplete)


def methods_and_problems(incomplete: str) -> list[str]:
    """Return the methods and problems that begin with the text."""
    return methods(incomplete) + problems(incomplete)


def _matches(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
