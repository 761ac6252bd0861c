"""Options and arguments that several commands have: one name, one type and one help text for one thing.

The first sentence of a help text says what the option is and is the same in every command; what a command does with it
follows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from . import completion

PROBLEM_HELP = "A problem, problem:orbit, or a file, ./my_problem.py, planets.csv."
OUTPUT_HELP = "Write the result there."
TIME_LIMIT_HELP = "Stop after this many seconds of the clock."
END_TIME_HELP = 'End time, a number; with a unit where the problem has one: "1e4 yr".'
QUANTITY_HELP = "Whose error: end-state, trajectory, energy, or a quantity that the problem names."
METHOD_HELP = "A method, a peer, or your own step, ./mine.py (not on scenes); repeat it."
QUICK_HELP = "Measure a small selection."
JOBS_HELP = "Number of parallel processes."
REQUIRES_HELP = "A trait of systems, such as separable."
PACKAGE_HELP = "A package of peers, such as rebound."
REPORTS_HELP = "A folder of reports, with their data."


def problem_argument(metavar: str = "PROBLEM", help: str = PROBLEM_HELP) -> Any:
    """The typer argument that names a problem."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=completion.problems)


def method_argument(help: str) -> Any:
    """The typer argument that names a method, a peer or a user's step."""
    return typer.Argument(metavar="METHOD", help=help, autocompletion=completion.methods_and_peers)


def time_limit(more: str) -> Any:
    """The typer option --time-limit; ``more`` tells in its help what happens at the limit, and the default."""
    return typer.Option("--time-limit", metavar="SECONDS", help=f"{TIME_LIMIT_HELP} {more}")


def output(metavar: str, more: str) -> Any:
    """The typer option --output; ``more`` tells in its help what is written, and to files of which endings."""
    return typer.Option("--output", metavar=metavar, help=f"{OUTPUT_HELP} {more}")


def quantity(more: str = "") -> Any:
    """The typer option --quantity, which names the quantity whose error is wanted; ``more`` is added to its help."""
    return typer.Option("--quantity", metavar="NAME", help=f"{QUANTITY_HELP} {more}".strip())


def quick(more: str) -> Any:
    """The typer option --quick; ``more`` tells in its help which selection is measured."""
    return typer.Option("--quick", help=f"{QUICK_HELP} {more}")


def jobs(more: str) -> Any:
    """The typer option --jobs; ``more`` tells in its help what the parallel processes do, and the default."""
    return typer.Option("--jobs", metavar="NUMBER", min=0, help=f"{JOBS_HELP} {more}")


def requires(more: str) -> Any:
    """The typer option --requires, which names a trait of systems such as separable; ``more`` is added to its help."""
    return typer.Option("--requires", metavar="TRAIT", help=f"{REQUIRES_HELP} {more}")


def package(more: str) -> Any:
    """The typer option --package, which names a package of integrators; ``more`` is added to its help."""
    return typer.Option("--package", metavar="NAME", help=f"{PACKAGE_HELP} {more}")


def problem_option(more: str) -> Any:
    """The typer option --problem; ``more`` is added to its help."""
    return typer.Option(
        "--problem", metavar="NAME", help=f"A problem, such as kepler. {more}", autocompletion=completion.problems
    )


Problem = Annotated[str | None, problem_argument()]
EndTime = Annotated[str | None, typer.Option("--t-end", metavar="TIME", help=END_TIME_HELP)]
Methods = Annotated[
    list[str],
    typer.Option("--method", metavar="NAME", help=METHOD_HELP, autocompletion=completion.methods_and_peers),
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
Reports = Annotated[Path, typer.Option("--reports", metavar="FOLDER", help=REPORTS_HELP)]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, numbers in full precision.")]
