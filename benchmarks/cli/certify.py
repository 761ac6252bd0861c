"""``certify``: what the certified references state, measured again by other means; or one state of one's own."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from .shared import WRONG, err, invalid_input, out, telling

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.reference.certificates.check import Outcome
    from phasebench.reference.certificates.stored import Certificate

#: Heading -> (column of `rows.row`, digits) of the table.
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
    problem: Annotated[list[str] | None, typer.Argument(help="Problems, or problem:orbit; all at first.")] = None,
    update: Annotated[bool, typer.Option(help="Compute the states anew and store them.")] = False,
    t_end: Annotated[
        float | None, typer.Option(help="Certify this one time of one problem, and store nothing.")
    ] = None,
    timeout: Annotated[float, typer.Option(help="Seconds that certifying one time may take.")] = 300.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure the stored reference states, their uncertainties and horizons again; exit code 1 where one is wrong."""
    from phasebench.benchmarks.problems import labels

    names = problem or []
    with invalid_input():
        if t_end is None:
            right = _stored(labels(names), update, as_json)
        elif len(names) != 1 or update:
            raise InvalidInput("--t-end certifies one problem and stores nothing: name one, as id or id:orbit")
        else:
            right = _one(names[0], t_end, timeout, as_json)
    raise typer.Exit(0 if right else WRONG)


def _stored(wanted: list[str], update: bool, as_json: bool) -> bool:
    """Measure what the certificates of these labels state; whether all of it holds and solvers agree."""
    outcomes = _renewed(wanted, update)
    if as_json:
        rows = [{k: None if v != v else v for k, v in _row(o).items()} for o in outcomes]  # JSON has no NaN
        print(json.dumps({"references": rows, "stored": update and all(o.holds for o in outcomes)}))
    else:
        _print_table(outcomes, update)
    return all(o.holds for o in outcomes)


def _renewed(wanted: list[str], update: bool) -> list[Outcome]:
    """The outcomes; while updating each that holds is stored at once, so that a run that is killed loses nothing."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from phasebench.benchmarks.problems import labels, problem
    from phasebench.reference.certificates import check, make, stored

    outcomes = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bars:
        bar = bars.add_task("certify", total=len(wanted))
        for label in wanted:
            bars.update(bar, description=label)
            made = problem(label)
            outcomes.append(check.renew(made) if update else check.recheck(made))
            if update and outcomes[-1].holds:
                stored.keep(outcomes[-1].certificate, labels([made.id]), make.versions())
            bars.update(bar, advance=1)
    return outcomes


def _row(outcome: Outcome) -> dict[str, object]:
    from phasebench.benchmarks.experiments.references.rows import row

    return row(outcome)


def _print_table(outcomes: list[Outcome], update: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    from phasebench.benchmarks.page.markdown import number
    from phasebench.reference.certificates.check import AGAIN
    from phasebench.reference.certificates.horizon import LIMIT

    table = Table(title=f"certified references (max norms at t_end; horizon: rounding to long double under {LIMIT:g})")
    for head in ("problem", *COLUMNS, ""):
        table.add_column(head, justify="right" if head in COLUMNS else "left", no_wrap=True)
    for r in map(_row, outcomes):
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


def _one(name: str, t_end: float, timeout: float, as_json: bool) -> bool:
    """Certify one time and print the state; whether the other solvers agree."""
    from phasebench.benchmarks.problems import problem
    from phasebench.reference.certificates import make
    from phasebench.reference.solvers import watch
    from phasebench.reference.solvers.taylor import ReferenceFailed

    if not timeout > 0:
        raise InvalidInput(f"--timeout is {timeout}; it must be a positive number of seconds")
    if not 0 < t_end < float("inf"):
        raise InvalidInput(f"--t-end is {t_end}; it must be a positive number")
    made = problem(name)
    try:
        with telling("certify") as tell, watch.watching(timeout, lambda told: tell(f"certify, {told}")):
            new = make.certify(made, [t_end])
    except watch.TooLong as late:
        told = f"{made.label} cannot be certified to {t_end:g} in {timeout:g} s (--timeout): {late}"
        raise InvalidInput(told) from None
    except ReferenceFailed as error:
        raise InvalidInput(f"{made.label} cannot be certified to {t_end!r}: {error}") from None
    if as_json:
        print(json.dumps(_state(made, new)))
    else:
        out.print("\n".join(_lines(made, new)), highlight=False, soft_wrap=True, markup=False)
    return new.ends[0].agree


def _state(made: Problem, new: Certificate) -> dict[str, object]:
    """A certified state for a program: its digits are text, since no double holds them."""
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
    """A certified state for a person."""
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
