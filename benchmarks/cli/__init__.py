"""The command line, a module per command: ``python -m benchmarks``, installed as ``phasebench``.

A new command is a function in a module of its own, entered in `COMMANDS`.  Heavy packages load only in the command
that needs them, so its module imports them inside the function.
"""

from __future__ import annotations

import gc
import sys
from typing import Annotated

import typer

from .advise import advise
from .audit import audit
from .cache import cache
from .certify import certify
from .cite import cite
from .compare import compare
from .integrate import integrate
from .listing import list_
from .report import report
from .run import run
from .stability import stability
from .validate import validate
from .workprecision import workprecision

#: Name -> the function, whose signature typer reads and whose docstring is the help.
COMMANDS = {
    "list": list_,
    "integrate": integrate,
    "run": run,
    "report": report,
    "advise": advise,
    "workprecision": workprecision,
    "certify": certify,
    "audit": audit,
    "compare": compare,
    "cite": cite,
    "validate": validate,
    "stability": stability,
    "cache": cache,
}

#: Objects made before Python looks for cycles among them: to import makes very many, and hardly a cycle.
YOUNG = 50_000


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"phasebench {version('phasebench')}")
        raise typer.Exit


def options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which.")] = False,
) -> None:
    """A validation benchmark suite for geometric integrators of Hamiltonian systems."""


def _made(commands: dict) -> typer.Typer:
    """The application of these commands."""
    made = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
    made.callback()(options)
    for name, command in commands.items():
        made.command(name)(command)
    return made


app = _made(COMMANDS)


def main() -> None:
    """The installed command; where it is one of `COMMANDS`, the others need not be made ready."""
    gc.set_threshold(YOUNG)
    only = {name: COMMANDS[name] for name in sys.argv[1:2] if name in COMMANDS}
    (_made(only) if only else app)()


__all__ = ["COMMANDS", "app", "main"]
