"""``workprecision``: error against time of methods and peers on any problem, as a table and a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from phasebench.integrators.errors import InvalidInput

from . import options
from .integrate import made
from .shared import check_file, invalid_input, numbers, print_json, say, show, telling, time_of, values, warn


def workprecision(
    problem: options.Problem = None,
    t_end: options.EndTime = None,
    method: options.Methods = [],  # noqa: B006
    quantity: Annotated[str, options.quantity()] = "end-state",
    set_: options.Settings = [],  # noqa: B006
    hamiltonian: options.Formula = None,
    constraint: options.Constraints = [],  # noqa: B006
    part: options.Parts = [],  # noqa: B006
    q: options.Coordinates = None,
    p: options.Momenta = None,
    output: Annotated[Path | None, options.output("FILE", "A figure: .png, .svg or .pdf.")] = None,
    as_json: options.Json = False,
) -> None:
    """Measure error against time of methods on a problem, from the widest step that works down to round-off."""
    from phasebench.benchmarks.measure.compilation import row_failures
    from phasebench.benchmarks.store import schema
    from phasebench.benchmarks.workprecision import CURVES, SUFFIXES
    from phasebench.benchmarks.workprecision import workprecision as measured

    with invalid_input():
        if t_end is None:
            raise InvalidInput("give --t-end, a positive number: where does the integration end?")
        if problem is None and hamiltonian is None:
            raise InvalidInput(
                "give a problem, as in: workprecision pendulum --t-end 100 --method pefrl --method heyoka"
            )
        if output is not None:
            check_file(output, SUFFIXES)
        q0, p0 = numbers(q, "q"), numbers(p, "p")
        chosen = made(problem, hamiltonian, values(set_, "set"), q0, p0, constraint, part)
        start = {} if hamiltonian is not None else {"q0": q0, "p0": p0}
        with telling("workprecision") as tell:
            span = time_of(t_end, chosen)
            found = measured(chosen, method, t_end=span, quantity=quantity, progress=tell, **start)
        if output is not None:
            found.plot(output)
    failed, warning = row_failures(found.rows)
    if as_json:
        figure = None if output is None else str(output)
        print_json(
            {
                schema.FIELD: schema.VERSION,
                "rows": list(found.rows),
                "figure": figure,
                "failed": failed,
                "warning": warning or None,
            }
        )
        return
    warn(warning)
    warn("; ".join(dict.fromkeys(f"{r['method']}: {r['shared']}" for r in found.rows if r["shared"])))
    show(f"seconds for an {found.title}", list(found.table()))
    if output is not None:
        more = f", with the first {CURVES} of {len(found.methods)}" if len(found.methods) > CURVES else ""
        say(f"written {output}{more}")
