"""``list``: what there is."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from .shared import show


class Kind(StrEnum):
    """What can be listed."""

    methods = "methods"
    problems = "problems"
    scenes = "scenes"
    peers = "peers"


def _methods() -> tuple[list[str], list[list[str]]]:
    from phasebench.benchmarks.experiments.catalogue import describe

    table = describe.methods()
    return list(table[0]), [list(r.values()) for r in table]


def _problems() -> tuple[list[str], list[list[str]]]:
    from phasebench.benchmarks.problems import PROBLEMS

    heads = ["problem", "name", "orbits (the first is the default)"]
    return heads, [[id, name, ", ".join(orbits)] for id, (_, name, orbits) in PROBLEMS.items()]


def _scenes() -> tuple[list[str], list[list[str]]]:
    from phasebench.benchmarks.problems.scenes import SCENES

    heads = ["scene", "problem", "purpose", "t_end", "h"]
    return heads, [[s.id, s.problem, s.purpose, f"{s.t_end:g}", ", ".join(f"{h:g}" for h in s.steps)] for s in SCENES]


def _peers() -> tuple[list[str], list[list[str]]]:
    from phasebench.reference.peers import PEERS

    heads = ["peer", "name", "package", "step", "problems", "license"]
    step = {True: "adaptive (--tol)", False: "fixed (--h)"}
    return heads, [[p.id, p.name, p.package, step[p.adaptive], p.scope, p.license] for p in PEERS]


TABLES = {Kind.methods: _methods, Kind.problems: _problems, Kind.scenes: _scenes, Kind.peers: _peers}


def list_(kind: Annotated[Kind, typer.Argument(help="What to list.")] = Kind.methods) -> None:
    """List methods, problems, scenes or peers."""
    show(kind.value, *TABLES[kind]())
