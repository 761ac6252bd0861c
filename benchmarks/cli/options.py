"""Options and arguments that several commands have: one name, one type and one help text for one thing.

The first sentence of a help text says what the option is and is the same in every command; what a command does with it
follows.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer


def _names(kind: str) -> list[str]:
    """The ids of a kind, without importing what computes with them."""
    if kind == "problems":
        from phasebench.benchmarks.problems import PROBLEMS

        return [*PROBLEMS, *(f"{name}:{orbit}" for name, (_, _, orbits) in PROBLEMS.items() for orbit in orbits)]
    if kind == "methods":
        from phasebench.integrators.registry import BY_ID
    else:
        from phasebench.reference.peers import BY_ID
    return [*BY_ID]


def completion(*kinds: str) -> Callable[[str], list[str]]:
    """The function by which a shell completes ids of problems, methods or peers."""

    def complete(incomplete: str) -> list[str]:
        return [name for kind in kinds for name in _names(kind) if name.startswith(incomplete)]

    return complete


TIME_LIMIT_HELP = "Stop after this many seconds of the clock."
PROBLEM_HELP = "A problem, problem:orbit, or a file, ./my_problem.py, planets.csv."


def problem_argument(metavar: str = "PROBLEM", help: str = PROBLEM_HELP) -> Any:
    """The typer argument that names a problem."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=completion("problems"))


def method_argument(help: str) -> Any:
    """The typer argument that names a method, a peer or a user's step."""
    return typer.Argument(metavar="METHOD", help=help, autocompletion=completion("methods", "peers"))


def _option(name: str, metavar: str | None, first: str, **settings: Any) -> Callable[..., Any]:
    """A function that makes the typer option of this name; its argument is added to the first sentence of the help."""

    def option(more: str = "") -> Any:
        return typer.Option(name, metavar=metavar, help=f"{first} {more}".strip(), **settings)

    return option


time_limit = _option("--time-limit", "SECONDS", TIME_LIMIT_HELP)
quantity = _option(
    "--quantity", "NAME", "Whose error: end-state, trajectory, energy, or a quantity that the problem names."
)
everything = _option("--all", None, "Nothing is left out.")
quick = _option("--quick", None, "Measure a small selection.")
jobs = _option("--jobs", "NUMBER", "Number of parallel processes.", min=0)
requires = _option("--requires", "TRAIT", "A trait of systems, such as separable.")
package = _option("--package", "NAME", "A package of peers, such as rebound.")
problem_option = _option("--problem", "NAME", "A problem, such as kepler.", autocompletion=completion("problems"))


def output(metavar: str, more: str) -> Any:
    """The typer option --output; ``more`` tells in its help what is written, and to files of which endings."""
    return typer.Option("--output", metavar=metavar, help=f"Write the result there. {more}")


Problem = Annotated[str | None, problem_argument()]
EndTime = Annotated[
    str | None,
    typer.Option(
        "--t-end", metavar="TIME", help='End time, a number; with a unit where the problem has one: "1e4 yr".'
    ),
]
Methods = Annotated[
    list[str],
    typer.Option(
        "--method",
        metavar="NAME",
        help="A method, a peer, or your own step, ./mine.py (not on scenes); repeat it.",
        autocompletion=completion("methods", "peers"),
    ),
]
Parameters = Annotated[
    list[str],
    typer.Option("--param", metavar="NAME=VALUE", help="A parameter of the method: lam=1/3; repeat it."),
]
Settings = Annotated[
    list[str], typer.Option("--set", metavar="NAME=NUMBER", help="A parameter of the problem: e=0.2; repeat it.")
]
Formula = Annotated[
    str | None,
    typer.Option(
        "--hamiltonian",
        metavar="FORMULA",
        help="Instead of PROBLEM, a formula of H in q, p; q1, p1, q2, ...; or x, px, y, ...: 'p**2/2 - cos(q)'.",
    ),
]
Constraints = Annotated[
    list[str],
    typer.Option(
        "--constraint",
        metavar="FORMULA",
        help="With --hamiltonian, a constraint g(q) = 0: 'q1**2 + q2**2 = 1'; repeat it.",
    ),
]
Parts = Annotated[
    list[str],
    typer.Option(
        "--part",
        metavar="FORMULA",
        help="With --hamiltonian, a part of H with an exact flow: '-p1**2/q1'; repeat it for all parts.",
    ),
]
Coordinates = Annotated[
    str | None,
    typer.Option("--q", metavar="NUMBERS", help="Initial coordinates: 0,0.82. Default: those of the problem."),
]
Momenta = Annotated[
    str | None, typer.Option("--p", metavar="NUMBERS", help="Initial momenta: 0.1,0. Default: those of the problem.")
]
Reports = Annotated[Path, typer.Option("--reports", metavar="FOLDER", help="A folder of reports, with their data.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, numbers in full precision.")]
