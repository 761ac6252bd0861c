"""``integrate``: integrate one problem with one method, peer or user's step, and report how it went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from phasebench.integrators.errors import InvalidInput

from . import options, trajectory
from .shared import (
    WRONG,
    check_file,
    compilation_shown,
    complain,
    invalid_input,
    numbers,
    out,
    pairs,
    print_json,
    telling,
    time_of,
    values,
)

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.every_step import Extreme, Extremes
    from phasebench.benchmarks.measure.integrator import Integrator
    from phasebench.benchmarks.measure.solution import Solution
    from phasebench.benchmarks.problems.base import Problem

#: The reason of no error of the end state where another quantity alone was asked for.
NOT_ASKED = "not asked for"
COUNTS = ("steps", "gradient", "hessian", "iterations", "fallbacks")
#: Of a state with more than MANY components, SHOWN are printed at either end.
MANY, SHOWN = 12, 3


def integrate(
    problem: Annotated[str, options.problem_argument()],
    method: Annotated[
        str | None, options.method_argument("A method, a peer, or the path of your own step, ./mine.py.")
    ] = None,
    h: Annotated[
        str | None,
        typer.Option(
            "--h",
            metavar="TIME",
            help="Step, as --t-end is given; adjusted so that a whole number of steps ends at --t-end.",
        ),
    ] = None,
    t_end: options.EndTime = None,
    steps: Annotated[
        int | None, typer.Option(metavar="NUMBER", help="Number of steps; in place of --h or of --t-end.")
    ] = None,
    t0: Annotated[
        str, typer.Option("--t0", metavar="TIME", help="Time at the start; an end before it goes back in time.")
    ] = "0",
    tol: Annotated[
        float | None,
        typer.Option(
            metavar="NUMBER", help="Tolerance of an adaptive peer, as its package means it. Default: the package's own."
        ),
    ] = None,
    param: options.Parameters = [],  # noqa: B006
    set_: options.Settings = [],  # noqa: B006
    hamiltonian: options.Formula = None,
    constraint: options.Constraints = [],  # noqa: B006
    part: options.Parts = [],  # noqa: B006
    q: options.Coordinates = None,
    p: options.Momenta = None,
    time_limit: Annotated[float | None, options.time_limit("The status is then timeout. Default: no limit.")] = None,
    error: Annotated[
        bool, typer.Option("--error", help="Print the error of the end state, against a stored or new reference.")
    ] = False,
    quantity: Annotated[
        str | None, options.quantity("It is printed, too; of a conserved one no error of the end state.")
    ] = None,
    output: Annotated[Path | None, options.output("FILE", "A trajectory: .csv or .npz.")] = None,
    every: Annotated[int, typer.Option(metavar="NUMBER", help="Write every Nth row to --output, and the last.")] = 1,
    as_json: options.Json = False,
) -> None:
    """Integrate a problem with a method and report how it went; exit code 0 only for status ok."""
    if hamiltonian is not None and method is None:
        problem, method = _label(problem)
    parameters: dict[str, str] = {}

    def report(reason: str) -> None:
        if not as_json:
            return complain(reason)
        named = {"problem": hamiltonian if problem is None else problem, "method": method, "params": parameters}
        print_json(named | {"status": "invalid", "reason": reason})

    with invalid_input(report):
        if method is None and hamiltonian is None:
            raise InvalidInput(
                "give a problem and a method, as in: integrate pendulum stormer-verlet --h 0.1 --t-end 1"
            )
        q0, p0 = numbers(q, "q"), numbers(p, "p")
        _check_order(problem, method)
        _check_output(output, every)
        chosen_problem = made(problem, hamiltonian, values(set_, "set"), q0, p0, constraint, part)
        parameters |= pairs(param, "--param")
        with compilation_shown(not as_json):
            from phasebench.benchmarks.measure.integrator import integrator

            chosen = integrator(method, parameters=parameters)
            wanted = Wanted(error, quantity, output, every)
            given = {"--h": h, "--t-end": t_end, "--t0": t0}
            step, span, begin = (time_of(text, chosen_problem, option) for option, text in given.items())
            common = {"h": step, "t_end": span, "steps": steps, "t0": begin, "q0": q0, "p0": p0}
            result = _integrated(chosen_problem, chosen, wanted, tol, time_limit, **common)
    if as_json:
        print_json(result)
    else:
        _print(result, begin, "H + p_t" if chosen_problem.system.driven else "H")
    raise typer.Exit(0 if result["status"] == "ok" else WRONG)


def made(
    name: str | None,
    hamiltonian: str | None,
    parameters: dict[str, float],
    q0: Sequence[float] | None,
    p0: Sequence[float] | None,
    constraints: Sequence[str] = (),
    parts: Sequence[str] = (),
) -> Problem:
    """The problem called ``name``, or the one of the formula ``hamiltonian``; ``name`` is then its label."""
    from phasebench.benchmarks.problems import PROBLEMS, file_and_orbit, problem

    if hamiltonian is None:
        if constraints or parts:
            option = "--constraint" if constraints else "--part"
            raise InvalidInput(f"{option} goes with --hamiltonian; a problem of a file or a name brings its own")
        return problem(name, **parameters)
    if name is not None and (name.partition(":")[0] in PROBLEMS or file_and_orbit(name)[0]):
        raise InvalidInput(f"both the problem '{name}' and --hamiltonian are given; leave out one of them")
    from phasebench.benchmarks.problems.user import from_formula

    return from_formula(hamiltonian, q0, p0, parameters, id=name, constraints=constraints, parts=parts)


def _check_order(problem: str | None, method: str | None) -> None:
    from phasebench.benchmarks.problems import PROBLEMS

    if method is None or method.partition(":")[0] not in PROBLEMS:
        return
    from phasebench.integrators.registry import BY_ID
    from phasebench.reference.peers import BY_ID as PEERS_BY_ID

    if problem in {*BY_ID, *PEERS_BY_ID}:
        raise InvalidInput(f"the problem comes first, then the method: integrate {method} {problem}")


def _label(word: str) -> tuple[str | None, str | None]:
    """(Label, method) from the only word given besides a formula of H: a label if it is the name of a known problem."""
    from phasebench.benchmarks.problems import PROBLEMS

    return (word, None) if word.partition(":")[0] in PROBLEMS else (None, word)


class Wanted(NamedTuple):
    """The outputs requested besides the end state: its error, a quantity's, the trajectory's file and every Nth row."""

    error: bool
    quantity: str | None
    output: Path | None
    every: int


def _check_output(output: Path | None, every: int) -> None:
    if every < 1:
        raise InvalidInput(f"--every is {every}; it must be a positive integer")
    if output is None and every > 1:
        raise InvalidInput("--every says which rows are written: give --output trajectory.csv, too")
    if output is not None:
        check_file(output, trajectory.SUFFIXES)


def _integrated(
    problem: Problem, integrator: Integrator, wanted: Wanted, tol: float | None, time_limit: float | None, **common: Any
) -> dict[str, Any]:
    if time_limit is not None and not integrator.stoppable:
        raise InvalidInput(f"'{integrator.id}' cannot be stopped: leave out --time-limit")
    from phasebench.benchmarks.measure import every_step
    from phasebench.benchmarks.measure.solution import Solution

    if wanted.quantity:
        from phasebench.benchmarks.measure.named_quantities import quantity

        quantity(problem, wanted.quantity)  # an unknown one is refused before anything is integrated
    every = None if wanted.output is None else wanted.every
    watched = every_step.watch(problem, integrator, every=every, tol=tol, timeout=time_limit, **common)
    solution = watched.solution
    if solution.status == "ok":
        solution = replace(solution, seconds=every_step.seconds(problem, integrator, watched, tol=tol, **common))
    parameters = {k: str(v) for k, v in integrator.record.parameters.items()}
    shown = Solution.of(solution)
    result = _result(problem, shown, watched.extremes, parameters if tol is None else {"tol": tol})
    if wanted.output is not None:  # first, so that it is not lost where an error cannot be told
        rows = trajectory.write(wanted.output, shown, 1 if integrator.stoppable else wanted.every)
        result["output"] = {"file": str(wanted.output), "rows": rows}
    if solution.status == "ok" and (wanted.error or wanted.quantity):
        result |= _errors(shown, integrator, wanted, tol, common)
    return result


def _errors(shown: Solution, integrator: Integrator, wanted: Wanted, tol: float | None, common: dict) -> dict[str, Any]:
    """The errors of the end state, unless not asked for or the quantity is conserved, and of the quantity."""
    from phasebench.benchmarks.measure import global_error as against
    from phasebench.benchmarks.measure.named_quantities import quantity
    from phasebench.reference.solvers.watch import watching

    chosen = wanted.quantity and quantity(shown.problem, wanted.quantity)
    problem, whole = shown._started(), shown.whole or shown
    t_end = float((whole.t[-1] if common["t_end"] is None else common["t_end"]) - common["t0"])
    found: dict[str, Any] = {
        "global_error": None,
        "reference": {"uncertainty": None, "horizon": None, "reason": NOT_ASKED},
    }
    with telling("reference") as tell, watching(inf, tell):
        if wanted.error and not (chosen and chosen.kept):
            found = against.end_error(problem, whole, t_end)
        if chosen:
            size = {"tol": tol} if integrator.adaptive else {"steps": whole.counts["steps"]}
            found["quantity_error"] = against.quantity_error(problem, integrator, chosen, t_end, size)
    return found


def _result(problem: Problem, solution: Solution, extremes: Extremes, parameters: dict[str, Any]) -> dict[str, Any]:
    def error(extreme: Extreme) -> dict[str, float | None]:
        return {"max": extreme.worst, "end": extreme.end}

    energy, start = error(extremes.energy), extremes.energy.first
    return {
        "problem": problem.label,
        "method": solution.method.id,
        "params": parameters,
        "h": solution.h,
        "steps": solution.counts["steps"],
        "t": float(solution.t[-1]),
        "q": [float(x) for x in solution.q[-1]],
        "p": [float(x) for x in solution.p[-1]],
        "energy_error": energy,
        "invariants": {name: error(extreme) for name, extreme in extremes.invariants.items()},
        "status": solution.status,
        "reason": solution.reason,
        "counts": {k: int(solution.counts.get(k, 0)) for k in COUNTS},
        "seconds": solution.seconds,
        "relative_energy_error": {k: x / abs(start) if start and x is not None else None for k, x in energy.items()},
    }


def shortened(state: list[float]) -> str:
    """The components of a state in full precision as text; of more than `MANY` only the first and last `SHOWN`."""
    if len(state) <= MANY:
        return ", ".join(map(repr, state))
    first, last = (", ".join(map(repr, part)) for part in (state[:SHOWN], state[-SHOWN:]))
    return f"{first}, ..., {last} ({len(state)} numbers; all with --json)"


def _print(result: dict[str, Any], t0: float, kept: str) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None)
    good = result["status"] == "ok"
    table.add_row("status", f"[{'green' if good else 'bold red'}]{result['status']}[/]")
    if result["reason"]:
        table.add_row("reason", Text(result["reason"]))
    names = ", ".join(f"{k}={v}" for k, v in result["params"].items())
    table.add_row("run", Text(f"{result['method']}{f'({names})' if names else ''} on {result['problem']}"))
    span = result["t"] - t0
    fixed = abs(result["steps"] * result["h"] - span) <= 1e-9 * abs(span)
    steps = "steps of h =" if fixed else "steps, rows every"
    table.add_row("time", f"t = {result['t']!r}, {result['steps']} {steps} {result['h']!r}")
    table.add_row("q", shortened(result["q"]))
    table.add_row("p", shortened(result["p"]))
    energy = {f"{kept} - H0": result["energy_error"], "dH / |H0|": result["relative_energy_error"]}
    errors = {f"energy error, {of}": e for of, e in energy.items()}
    errors |= {f"{name} error": e for name, e in result["invariants"].items()}
    for name, e in errors.items():
        known = e["max"] is not None
        words = f"at most {e['max']:.3e}, at the end {e['end']:+.3e}" if known else "unknown"
        table.add_row(Text(name), words)
    if "reference" in result and result["reference"].get("reason") != NOT_ASKED:
        table.add_row("global error", Text(_told(result["global_error"], result["reference"])))
    if "quantity_error" in result:
        e = result["quantity_error"]
        unit = "dH / H's terms" if e["quantity"] == "energy" else e["unit"]
        table.add_row(Text(f"{e['quantity']} error, {unit}"), Text(_told(e["error"], e)))
    if "output" in result:
        table.add_row("written", Text(f"{result['output']['rows']} rows to {result['output']['file']}"))
    table.add_row("counts", ", ".join(f"{k} {v}" for k, v in result["counts"].items()))
    table.add_row("seconds", f"{result['seconds']:.6f} (warm integration alone)")
    out.print(table, highlight=False)


def _told(error: float | None, reference: dict[str, Any]) -> str:
    """An error against a reference as text, with the uncertainty and the horizon, or why there is none."""
    if error is None:
        return f"none: {reference['reason']}"
    if not reference["uncertainty"]:
        return f"{error:.3e}"
    reach = f"; horizon t = {reference['horizon']:.6g}" if "horizon" in reference else ""
    return f"{error:.3e} (the reference is known to {reference['uncertainty']:.1e}{reach})"
