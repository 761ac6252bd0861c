"""``certify``: recompute and check the certified reference states, or certify one state at a chosen time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from . import options
from .shared import WRONG, err, invalid_input, out, print_json, say, telling, time_of

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.reference.certificates.check import Outcome
    from phasebench.reference.certificates.stored import Certificate

#: Heading -> (column of `Outcome.row`, digits) of the table.
COLUMNS = {
    "t_end": ("t_end", 4),
    "error": ("error", 2),
    "uncertainty": ("uncertainty", 2),
    "horizon": ("horizon", 4),
    "earliest": ("earliest", 4),
    "latest": ("latest", 4),
    "second solver": ("distance", 2),
    "its own": ("its uncertainty", 2),
}


def certify(
    problem: Annotated[
        list[str] | None, options.problem_argument("PROBLEM", "Problems, or problem:orbit. Default: all.")
    ] = None,
    update: Annotated[bool, typer.Option("--update", help="Compute the states anew and store them.")] = False,
    t_end: options.EndTime = None,
    time_limit: Annotated[float, options.time_limit("For --t-end; an error says how far it came.")] = 300.0,
    as_json: options.Json = False,
) -> None:
    """Recompute the stored reference states, their uncertainties and horizons; exit code 1 if one of them is wrong.

    With --t-end, certify the state of one problem at this time, and store nothing.
    """
    from phasebench.benchmarks.problems import labels

    names = problem or []
    with invalid_input():
        if t_end is None:
            right = _stored(labels(names), update, as_json)
        elif len(names) != 1 or update:
            raise InvalidInput("--t-end certifies one problem and stores nothing: name one, as id or id:orbit")
        else:
            right = _one(names[0], t_end, time_limit, as_json)
    raise typer.Exit(0 if right else WRONG)


def _stored(wanted: list[str], update: bool, as_json: bool) -> bool:
    outcomes = _renewed(wanted, update)
    if as_json:
        rows = [o.row() for o in outcomes]
        print_json({"references": rows, "stored": update and all(o.holds for o in outcomes)})
    else:
        _print_table(outcomes, update)
    return all(o.holds for o in outcomes)


def _renewed(wanted: list[str], update: bool) -> list[Outcome]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from phasebench.benchmarks.measure.certify import recheck

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bars:
        bar = bars.add_task("certify", total=len(wanted))
        begun = iter(range(len(wanted)))
        outcomes = recheck(wanted, lambda label: bars.update(bar, description=label, completed=next(begun)), update)
        bars.update(bar, completed=len(wanted))
    return outcomes


def _print_table(outcomes: list[Outcome], update: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    from phasebench.benchmarks.page.markdown import number
    from phasebench.reference.certificates.check import AGAIN
    from phasebench.reference.certificates.horizon import LIMIT

    table = Table(title=f"certified references (max norms at t_end; horizon: rounding to long double under {LIMIT:g})")
    for head in ("problem", *COLUMNS, ""):
        table.add_column(head, justify="right" if head in COLUMNS else "left", no_wrap=True)
    for r in (o.row() for o in outcomes):
        verdict = [str(r["changed"])] if r["changed"] else []
        verdict += [f"{r['disagree']} of {r['pairs']} comparisons disagree"] if r["disagree"] else []
        verdict += [f"{r['unchecked']} of {r['states']} states without a comparison"] if r["unchecked"] else []
        cells = (number(r[column], digits) for column, digits in COLUMNS.values())
        table.add_row(str(r["problem"]), *cells, "; ".join(verdict) or "ok")
    (out if out.is_terminal else Console(width=200)).print(table)
    wrong = [o.certificate.problem for o in outcomes if not o.holds]
    said = f"wrong: {', '.join(wrong)}" if wrong else "all that they state holds"
    out.print(f"{len(outcomes)} measured again in {AGAIN.bits} bits; {said}", highlight=False)
    if update:
        moved = [f"{o.certificate.problem} ({o.moved})" for o in outcomes if o.moved]
        kept = f"{len(outcomes) - len(wrong)} stored; digits that moved: {', '.join(moved) or 'none'}"
        out.print(kept, highlight=False)


def _one(name: str, end: str, time_limit: float, as_json: bool) -> bool:
    from phasebench.benchmarks.measure.certify import certify_end
    from phasebench.benchmarks.problems import problem

    made = problem(name)
    t_end = time_of(end, made)
    if not t_end > 0:
        raise InvalidInput(f"--t-end is {end}; it must be a positive number")
    if not time_limit > 0:
        raise InvalidInput(f"--time-limit is {time_limit:g}; it must be a positive number of seconds")
    with telling("certify") as tell:
        new = certify_end(made, t_end, time_limit, lambda told: tell(f"certify, {told}"))
    if as_json:
        print_json(_state(made, new))
    else:
        say("\n".join(_lines(made, new)))
    return new.ends[0].agree


def _state(made: Problem, new: Certificate) -> dict[str, object]:
    """A certified state as a JSON object; its digits are text, since no double holds them."""
    (end,) = new.ends
    checks = [
        {
            "solver": c.solver,
            "distance": c.distance,
            "uncertainty": c.uncertainty,
            "agrees": end.agrees(c) if end.compares(c) else None,
        }
        for c in end.checks
    ]
    return {
        "problem": made.label,
        "params": dict(made.parameters),
        "t": end.t,
        "q": end.q_text,
        "p": end.p_text,
        "uncertainty": end.uncertainty,
        "long_double": end.long_double,
        "energy": end.energy,
        "limit": new.limit,
        "horizon": new.horizon,
        "earliest": new.earliest,
        "latest": new.latest,
        "digits_horizon": new.digits_horizon,
        "checks": checks,
    }


def _lines(made: Problem, new: Certificate) -> list[str]:
    from phasebench.benchmarks.page.markdown import number

    (end,) = new.ends
    lines = [f"{made.label} at t = {end.t!r}"]
    for name, texts in (("q", end.q_text), ("p", end.p_text)):
        lines += [f"  {name}{i} = {x}" for i, x in enumerate(texts, 1)]
    lines += [
        f"uncertainty {number(end.uncertainty)} (max norm, measured in {new.bits} bits); long double differs by "
        f"{number(end.long_double)}",
        f"energy changed by {number(end.energy)} of the sum of its terms",
        f"rounding to long double stays under {new.limit:g} of the state to t = {number(new.horizon, 6)}",
        f"in the median, in 95 of 100 draws to between t = {number(new.earliest, 6)} and {number(new.latest, 6)}",
    ]
    for c in end.checks:
        verb = "agrees" if end.agrees(c) else "DISAGREES" if end.compares(c) else "is no comparison"
        lines.append(f"{c.solver} {verb}: distance {number(c.distance)}, its own uncertainty {number(c.uncertainty)}")
    return lines
