"""The command line, a module per command: ``python -m benchmarks``, installed as ``phasebench``.

A new command is a function in a module of its own, entered in `COMMANDS`.  Heavy packages load only in the command
that needs them, so its module imports them inside the function.
"""

from __future__ import annotations

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

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"phasebench {version('phasebench')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which.")] = False,
) -> None:
    """A validation benchmark suite for geometric integrators of Hamiltonian systems."""


for name, command in COMMANDS.items():
    app.command(name)(command)


def main() -> None:
    """The installed command."""
    app()


__all__ = ["COMMANDS", "app", "main"]
