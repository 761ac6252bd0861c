"""``list``: list methods, problems, scenes (problems with a time span) or peers (integrators of other packages)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Annotated, Any

import typer

from phasebench.integrators.errors import InvalidInput, unknown_name

from . import options
from .shared import invalid_input, out, print_json, show, width


class Kind(StrEnum):
    """What ``list`` can list; scenes are problems with a span, peers integrators of other packages."""

    methods = "methods"
    problems = "problems"
    scenes = "scenes"
    peers = "peers"


Row = dict[str, Any]
#: Methods that are listed whether they win or not, being usual or the talks' own; and how many are listed unless all.
USUAL = (
    *("symplectic-euler-p", "stormer-verlet", "ruth-3", "forest-ruth", "yoshida-6a", "yoshida-8d", "rk4"),
    *("implicit-midpoint", "gauss-2", "scheme-i", "scheme-ii", "scheme-iii", "scheme-iv", "scheme-v", "avf"),
    "gauss-equip-2",
)
SHOWN = 30
#: A method wins where its time is at most this times that of the fastest integrator.
TIE = 1.05


def _wins() -> dict[str, int]:
    """Integrator -> on how many problems and powers of ten of the error it is the fastest or ties with that."""
    from phasebench.benchmarks.advice.prior import ANY, TABLE

    wins: dict[str, int] = {}
    for problem, decades in TABLE.load().factors.items():
        for factors in decades.values() if problem != ANY else ():
            for integrator, factor in factors.items():
                wins[integrator] = wins.get(integrator, 0) + (factor <= TIE)
    return wins


def _methods() -> list[Row]:
    from phasebench.integrators.registry import METHODS

    wins = _wins()
    return [
        {
            "method": m.id,
            "wins": wins.get(m.id, 0),
            "order": m.order,
            "family": m.family.replace("_", "-"),
            "symplectic": m.symplectic,
            "energy": m.energy,
            "requires": list(m.requires),
            "symmetric": m.symmetric,
            "q.D p": m.quadratic,
            "parameters": {k: v if isinstance(v, (int, str)) else str(v) for k, v in m.parameters.items()},
            "name": m.name,
            "source": m.source,
            "cite": list(m.cite),
        }
        for m in METHODS
    ]


def _best(rows: list[Row]) -> list[Row]:
    """The methods to show unless all are asked for: those that are usual, and as many that win most as make `SHOWN`."""
    winners = [row["method"] for row in _ranked(rows) if row["method"] not in USUAL][: SHOWN - len(USUAL)]
    return [row for row in rows if row["method"] in (*USUAL, *winners)]


def _ranked(rows: list[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: -row.get("wins", 0))


def _problems() -> list[Row]:
    from phasebench.benchmarks.problems import PROBLEMS

    return [{"problem": id, "orbits": list(orbits), "name": name} for id, (_, name, orbits) in PROBLEMS.items()]


def _scenes() -> list[Row]:
    from phasebench.benchmarks.problems.questions import QUESTIONS
    from phasebench.benchmarks.problems.scenes import SCENES

    held = [(s.id, s.problem, s.t_end, s.purpose, "", (), s.steps) for s in SCENES]
    asked = [(q.id, q.problem, q.t_end, "trade", q.quantity, q.accuracies, ()) for q in QUESTIONS]
    heads = ("scene", "problem", "t_end", "purpose", "quantity", "accuracies", "h")
    return [
        {k: list(v) if isinstance(v, tuple) else v for k, v in zip(heads, row, strict=True)} for row in held + asked
    ]


def _peers() -> list[Row]:
    from phasebench.reference.installed import version_of
    from phasebench.reference.peers import PEERS

    installed = {package: version_of(package) for package in dict.fromkeys(p.package for p in PEERS)}
    return [
        {
            "peer": p.id,
            "order": p.order,
            "step": "adaptive (--tol)" if p.adaptive else "fixed (--h)",
            "installed": installed[p.package],
            "package": p.package,
            "problems": p.scope,
            "name": p.name,
            "about": p.about,
            "license": p.license,
            "source": p.source,
        }
        for p in PEERS
    ]


TABLES: dict[Kind, Callable[[], list[Row]]] = {
    Kind.methods: _methods,
    Kind.problems: _problems,
    Kind.scenes: _scenes,
    Kind.peers: _peers,
}
#: Filters whose value must occur in their column, in which a cell is one value or a list.
NAMED = ("family", "requires", "energy", "package", "problem")


def list_(
    kind: Annotated[Kind, typer.Argument(metavar="KIND", help="methods, problems, scenes or peers.")] = Kind.methods,
    order: Annotated[int | None, typer.Option(metavar="NUMBER", help="Methods and peers of this order.")] = None,
    family: Annotated[str | None, typer.Option(metavar="NAME", help="Methods of this family: splitting.")] = None,
    requires: Annotated[str | None, options.requires("Methods that require it; 'nothing': none.")] = None,
    energy: Annotated[
        str | None, typer.Option(metavar="HOW", help="Methods that keep the energy so: round-off, bounded.")
    ] = None,
    symplectic: Annotated[
        bool | None, typer.Option("--symplectic/--no-symplectic", help="Methods that are symplectic, or are not.")
    ] = None,
    symmetric: Annotated[
        bool | None, typer.Option("--symmetric/--no-symmetric", help="Methods that are symmetric, or are not.")
    ] = None,
    package: Annotated[str | None, options.package("Its peers.")] = None,
    installed: Annotated[
        bool | None,
        typer.Option("--installed/--not-installed", help="Peers whose package is installed, or is not."),
    ] = None,
    problem: Annotated[str | None, options.problem_option("Its scenes.")] = None,
    every: Annotated[
        bool, options.everything(f"Else the {SHOWN} methods that win most or are usual; --json has all.")
    ] = False,
    as_json: options.Json = False,
) -> None:
    """List methods, problems, scenes or peers; an option selects among all those that it names."""
    wanted = {
        "order": order,
        "family": family,
        "requires": requires,
        "energy": energy,
        "symplectic": symplectic,
        "symmetric": symmetric,
        "package": package,
        "installed": installed,
        "problem": problem,
    }
    with invalid_input():
        wanted = {k: v for k, v in wanted.items() if v is not None}
        rows = _chosen(kind, TABLES[kind](), wanted)
    some = _best(rows) if kind is Kind.methods and not (every or wanted) else rows
    if as_json:
        print_json(rows)
    elif not rows:
        print(f"none of the {kind.value}")
    else:
        count = f"{len(some)} of " if len(some) < len(rows) else ""
        show(
            f"{count}{len(rows)} {kind.value}",
            [{head: _text(value) for head, value in row.items()} for row in _ranked(some)],
        )
        if kind is Kind.methods:
            told = "wins: on so many problems and powers of ten of the error none is faster by more than a twentieth"
            out.print(told, highlight=False, width=width())


def _chosen(kind: Kind, rows: list[Row], wanted: Mapping[str, Any]) -> list[Row]:
    for name, value in wanted.items():
        if name not in rows[0] or (kind is Kind.problems and name == "problem"):
            raise InvalidInput(f"--{name} is no option of {kind.value}")
        if name in NAMED:
            known = {x for row in rows for x in _values(row[name])}
            if value not in known:
                raise unknown_name(name, value, known)
    return [row for row in rows if all(_is(row[name], value) for name, value in wanted.items())]


def _values(cell: object) -> list:
    """The values of an option that match a table cell; an empty list is matched by "nothing"."""
    if isinstance(cell, list):
        return cell or ["nothing"]
    return [cell, cell.partition(":")[0]] if isinstance(cell, str) else [cell]


def _is(cell: object, value: object) -> bool:
    """True if a table cell matches an option's value; --installed: a version, not None."""
    return (
        (cell is not None) == value
        if isinstance(value, bool) and not isinstance(cell, bool)
        else value in _values(cell)
    )


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(_text, value)) or "-"
    if isinstance(value, dict):
        return ", ".join(f"{k}={v}" for k, v in value.items()) or "-"
    return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
