"""``workprecision``: error against time of methods and peers on any problem, as a table and a figure."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from phasebench.integrators.errors import InvalidInput

from .integrate import made
from .shared import invalid_input, numbers, out, print_json, show, telling, values, warn

#: The errors of the table, and curves of a figure at most.
ACCURACIES = tuple(10.0**-k for k in range(1, 14, 2))
CURVES = 9


def workprecision(
    problem: Annotated[
        str | None,
        typer.Argument(metavar="PROBLEM", help="A problem, problem:orbit, or the path of your own, ./my_problem.py."),
    ] = None,
    t_end: Annotated[float | None, typer.Option(help="End time.")] = None,
    methods: Annotated[
        str | None, typer.Option(help="Methods, peers, files with commas between; at first a few of each side.")
    ] = None,
    quantity: Annotated[
        str, typer.Option(help="Of what: end-state, trajectory, energy, or a name of the problem's own.")
    ] = "end-state",
    set_: Annotated[list[str], typer.Option("--set", help="A problem's parameter: e=0.2.")] = [],  # noqa: B006
    hamiltonian: Annotated[str | None, typer.Option(help="Instead of PROBLEM, a formula of H.")] = None,
    q: Annotated[str | None, typer.Option(help="Initial coordinates: 0,0.82.")] = None,
    p: Annotated[str | None, typer.Option(help="Initial momenta: 0.1,0.")] = None,
    output: Annotated[Path | None, typer.Option(help="The figure: a file .png.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure error against time over steps and tolerances, from where a method breaks to round-off."""
    with invalid_input():
        if t_end is None or not t_end > 0:
            raise InvalidInput("give --t-end, a positive number: where does the integration end?")
        _check(output)
        rows = measured(_asked(problem, hamiltonian, set_, q, p), t_end, quantity, methods)
        if output is not None:
            _figure(rows, output)
    from phasebench.benchmarks.measure.compilation import row_failures

    failed, warning = row_failures(rows)
    if as_json:
        figure = None if output is None else str(output)
        print_json({"rows": rows, "figure": figure, "failed": failed, "warning": warning or None})
        return
    warn(warning)
    warn("; ".join(dict.fromkeys(f"{r['method']}: {r['shared']}" for r in rows if r["shared"])))
    first = rows[0]
    title = f"seconds for an error of the {first['quantity']} of {first['problem']} to t = {first['t_end']:g}"
    show(title, list(table(rows)))
    if output is not None:
        out.print(f"written {output}", highlight=False, markup=False)


def _asked(problem, hamiltonian, set_, q, p):
    """The problem that is named, from the state that is given."""
    from phasebench.benchmarks.measure.global_error import started

    if problem is None and hamiltonian is None:
        raise InvalidInput("give a problem, as in: workprecision pendulum --t-end 100 --methods pefrl,heyoka")
    q0, p0 = numbers(q, "q"), numbers(p, "p")
    chosen = made(problem, hamiltonian, values(set_, "set"), q0, p0)
    return chosen if hamiltonian is not None else started(chosen, q0, p0)


def measured(problem, t_end: float, quantity: str, methods: str | None) -> list[dict[str, Any]]:
    """The rows of methods, names with commas between, on a problem."""
    from phasebench.benchmarks.advice import ladder
    from phasebench.benchmarks.measure.integrator import integrator
    from phasebench.benchmarks.measure.quantities import quantity as quantity_of

    ask = ladder.asked(problem, t_end, quantity_of(problem, quantity))
    chosen = [integrator(m.strip()) for m in methods.split(",") if m.strip()] if methods else ladder.chosen(ask)
    with telling("workprecision") as tell:
        return ladder.ladders(ask, chosen, tell)


def _check(output: Path | None) -> None:
    if output is not None and output.suffix.lower() != ".png":
        raise InvalidInput(f"--output is {output}; a figure is a file .png")
    if output is not None and not output.parent.is_dir():
        raise InvalidInput(f"--output is {output}, and there is no folder {output.parent}")
    if output is not None and (output.is_dir() or not os.access(output if output.exists() else output.parent, os.W_OK)):
        raise InvalidInput(f"--output {output} cannot be written")


def table(rows: list[dict[str, Any]]) -> Iterable[dict[str, str]]:
    """A line for each method: the seconds of its cheapest run that meets each accuracy, and its least error."""
    for method in dict.fromkeys(r["method"] for r in rows):
        ended = [r for r in rows if r["method"] == method and r["status"] == "ok"]
        line = {"method": method}
        for accuracy in ACCURACIES:
            enough = [r["seconds"] for r in ended if r["error"] + r["uncertainty"] <= accuracy]
            line[f"{accuracy:.0e}"] = f"{min(enough):.2g}" if enough else "-"
        line["least error"] = f"{min(r['error'] for r in ended):.1e}" if ended else "-"
        yield line


def _figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Error against seconds, a curve a method."""
    from phasebench.benchmarks.page import style

    names = list(dict.fromkeys(r["method"] for r in rows))[:CURVES]
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 4.2)
        for name, look in zip(names, style.looks(), strict=False):
            ended = [r for r in rows if r["method"] == name and r["status"] == "ok" and 0 < r["error"] < 1e3]
            axes.loglog([r["error"] for r in ended], [r["seconds"] for r in ended], label=name, **look)
        known = rows[0]["uncertainty"]
        if known > 0:
            axes.axvline(known, color=style.GREY, linewidth=0.8, linestyle=":")
        axes.invert_xaxis()
        axes.set(xlabel=f"error of the {rows[0]['quantity']}", ylabel="seconds, warm, without output")
        style.legend_above(figure, axes, 3)
        try:
            style.write(figure, path)
        except OSError as error:
            raise InvalidInput(f"--output {path} cannot be written: {error.strerror or error}") from None
