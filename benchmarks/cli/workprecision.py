"""``workprecision``: error against time of methods and peers on any problem, as a table and a figure."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from .integrate import made
from .shared import END_TIME, end_time, err, invalid_input, numbers, out, print_json, show, telling, values, warn


def workprecision(
    problem: Annotated[
        str | None,
        typer.Argument(metavar="PROBLEM", help="A problem, problem:orbit, or a file, ./my_problem.py, planets.csv."),
    ] = None,
    t_end: Annotated[str | None, typer.Option(help=END_TIME)] = None,
    method: Annotated[
        list[str],
        typer.Option(help="A method, a peer, or the path of your own step; repeat it. Default: a few of each side."),
    ] = [],  # noqa: B006
    methods: Annotated[str | None, typer.Option(hidden=True)] = None,
    quantity: Annotated[
        str, typer.Option(help="Of what: end-state, trajectory, energy, or a name of the problem's own.")
    ] = "end-state",
    set_: Annotated[list[str], typer.Option("--set", help="A problem's parameter: e=0.2.")] = [],  # noqa: B006
    hamiltonian: Annotated[str | None, typer.Option(help="Instead of PROBLEM, a formula of H.")] = None,
    q: Annotated[str | None, typer.Option(help="Initial coordinates: 0,0.82.")] = None,
    p: Annotated[str | None, typer.Option(help="Initial momenta: 0.1,0.")] = None,
    output: Annotated[Path | None, typer.Option(help="The figure: a file .png, .svg or .pdf.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure error against time over steps and tolerances, from where a method breaks to round-off."""
    from phasebench.benchmarks.measure.compilation import row_failures
    from phasebench.benchmarks.workprecision import CURVES
    from phasebench.benchmarks.workprecision import workprecision as measured

    with invalid_input():
        if t_end is None:
            raise InvalidInput("give --t-end, a positive number: where does the integration end?")
        if problem is None and hamiltonian is None:
            raise InvalidInput(
                "give a problem, as in: workprecision pendulum --t-end 100 --method pefrl --method heyoka"
            )
        _check(output)
        q0, p0 = numbers(q, "q"), numbers(p, "p")
        chosen = made(problem, hamiltonian, values(set_, "set"), q0, p0)
        start = {} if hamiltonian is not None else {"q0": q0, "p0": p0}
        with telling("workprecision") as tell:
            span = end_time(t_end, chosen)
            found = measured(chosen, named(method, methods), t_end=span, quantity=quantity, progress=tell, **start)
        if output is not None:
            found.plot(output)
    failed, warning = row_failures(found.rows)
    if as_json:
        figure = None if output is None else str(output)
        print_json({"rows": list(found.rows), "figure": figure, "failed": failed, "warning": warning or None})
        return
    warn(warning)
    warn("; ".join(dict.fromkeys(f"{r['method']}: {r['shared']}" for r in found.rows if r["shared"])))
    show(f"seconds for an {found.title}", list(found.table()))
    if output is not None:
        more = f", with the first {CURVES} of {len(found.methods)}" if len(found.methods) > CURVES else ""
        out.print(f"written {output}{more}", highlight=False, markup=False)


def named(method: list[str], methods: str | None) -> list[str]:
    """The names of --method, and of the older --methods with commas between."""
    if methods is None:
        return method
    err.print("--methods is now --method, once for each", highlight=False)
    return [*method, *(m.strip() for m in methods.split(",") if m.strip())]


def _check(output: Path | None) -> None:
    from phasebench.benchmarks.workprecision import SUFFIXES

    if output is not None and output.suffix.lower() not in SUFFIXES:
        raise InvalidInput(f"--output is {output}; a figure is a file {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")
    if output is not None and not output.parent.is_dir():
        raise InvalidInput(f"--output is {output}, and there is no folder {output.parent}")
    if output is not None and (output.is_dir() or not os.access(output if output.exists() else output.parent, os.W_OK)):
        raise InvalidInput(f"--output {output} cannot be written")
