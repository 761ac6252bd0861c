"""The command line, a module per command: ``python -m phasebench``, installed as ``phasebench``.

A new command is a function in a module of its own, entered in `COMMANDS` with an example that a test runs.  Options
that several commands have are in `options`, their old spellings in `spellings`.  Heavy packages load only in the
command that needs them, so its module imports them inside the function.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Mapping
from typing import Annotated, NamedTuple

import typer

from phasebench.integrators.compile.progress import QUIET
from phasebench.integrators.statuses import STATUSES

from . import spellings
from .advise import advise
from .audit import audit
from .cache import cache
from .certify import certify
from .cite import cite
from .compare import compare
from .drift import drift
from .elsewhere import elsewhere
from .integrate import integrate
from .listing import list_
from .report import report
from .run import run
from .stability import stability
from .validate import validate
from .workprecision import workprecision

#: What the help of a command says of how a run ends.
ENDINGS = ("Every run ends with a status:", *(f"{name}: {s.meaning}" for name, s in STATUSES.items()))


class Entry(NamedTuple):
    """A command: its function, whose docstring is the help, the arguments of an example, notes above it, its panel."""

    run: Callable[..., None]
    example: str
    notes: tuple[str, ...] = ()
    panel: str = "Commands"


#: The panel of commands that serve the suite itself.
SUITE = "For the suite"


COMMANDS = {
    "advise": Entry(advise, "pendulum --t-end 5 --accuracy 1e-3"),
    "integrate": Entry(integrate, "pendulum pefrl --h 0.1 --t-end 10 --error", ENDINGS),
    "validate": Entry(validate, "./my_step.py --output my-certificate"),
    "stability": Entry(stability, "scheme-i --param lam=1/2"),
    "workprecision": Entry(workprecision, "pendulum --t-end 2 --method pefrl --method heyoka"),
    "drift": Entry(drift, "energies.csv"),
    "list": Entry(list_, "methods --order 4 --symplectic"),
    "run": Entry(run, "--scene lotka-volterra-t1 --method rk4 --quick", panel=SUITE),
    "report": Entry(report, "--reports my-report --rows rows.jsonl", panel=SUITE),
    "compare": Entry(compare, "old-report my-report --lines 5", panel=SUITE),
    "certify": Entry(certify, "harmonic-oscillator --t-end 1", panel=SUITE),
    "audit": Entry(audit, "--peer rebound-leapfrog --quick", panel=SUITE),
    "elsewhere": Entry(elsewhere, "elsewhere.csv --method pefrl", panel=SUITE),
    "cite": Entry(cite, "pefrl kepler", panel=SUITE),
    "cache": Entry(cache, "--json", panel=SUITE),
}

#: Threshold of Python's garbage collector: imports make very many objects, and hardly a cycle among them.
YOUNG = 200_000


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"phasebench {version('phasebench')}")
        raise typer.Exit


def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version of phasebench.")
    ] = False,
) -> None:
    """A validation benchmark suite for geometric integrators of Hamiltonian systems."""


def application(commands: Mapping[str, Entry], completion: bool = True) -> typer.Typer:
    """Return the typer application with these commands; ``completion`` adds the options that install it in a shell."""
    result = typer.Typer(no_args_is_help=True, add_completion=completion, pretty_exceptions_enable=False)
    result.callback()(root)
    for name, entry in commands.items():
        lines = (*entry.notes, "Example:", f"phasebench {name} {entry.example}")
        epilog = "\n\n".join(lines)  # an empty line is a line break
        result.command(name, cls=spellings.Command, epilog=epilog, rich_help_panel=entry.panel)(entry.run)
    return result


app = application(COMMANDS)


def main() -> None:
    """Run the command line on the arguments of the process; set up only the command that is called, to start faster."""
    os.environ[QUIET] = "1"
    gc.freeze()
    gc.set_threshold(YOUNG)
    only = {name: COMMANDS[name] for name in sys.argv[1:2] if name in COMMANDS}
    (application(only, completion=False) if only else app)()


__all__ = ["COMMANDS", "app", "application", "main"]
