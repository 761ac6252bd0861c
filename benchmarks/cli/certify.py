"""``certify``: the certified references computed anew, or one state of one's own."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from .shared import WRONG, err, invalid_input, out

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.reference.certificates.check import Outcome
    from phasebench.reference.certificates.stored import Certificate

#: Heading -> (column of `rows.row`, digits) of the table.
COLUMNS = {
    "t_end": ("t_end", 4),
    "uncertainty": ("uncertainty", 2),
    "long double": ("long double", 2),
    "horizon": ("horizon", 4),
    "second solver": ("distance", 2),
    "its own": ("its uncertainty", 2),
    "moved by": ("moved by", 4),
}


def certify(
    problem: Annotated[list[str] | None, typer.Argument(help="Problems, or problem:orbit; all at first.")] = None,
    update: Annotated[bool, typer.Option(help="Store what was computed.")] = False,
    t_end: Annotated[
        float | None, typer.Option(help="Certify this one time of one problem, and store nothing.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Compute stored reference states anew and show that nothing moved; exit code 1 where something did."""
    from phasebench.benchmarks.problems import labels

    names = problem or []
    with invalid_input():
        if t_end is None:
            right = _stored(labels(names), update, as_json)
        elif len(names) != 1 or update:
            raise InvalidInput("--t-end certifies one problem and stores nothing: name one, as id or id:orbit")
        else:
            right = _one(names[0], t_end, as_json)
    raise typer.Exit(0 if right else WRONG)


def _stored(wanted: list[str], update: bool, as_json: bool) -> bool:
    """Compute the certificates of these labels anew; whether nothing moved (unless it is stored) and solvers agree."""
    outcomes = _renewed(wanted, update)
    if as_json:
        rows = [{k: None if v != v else v for k, v in _row(o).items()} for o in outcomes]  # JSON has no NaN
        print(json.dumps({"references": rows, "stored": update}))
    else:
        _print_table(outcomes, update)
    return all(o.agree if update else o.holds for o in outcomes)


def _renewed(wanted: list[str], update: bool) -> list[Outcome]:
    """The outcomes; while updating each is stored at once, so that a run that is killed loses nothing."""
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
            outcomes.append(check.renew(made, mend=update))
            if update:
                stored.keep(outcomes[-1].fresh, labels([made.id]), make.versions())
            bars.update(bar, advance=1)
    return outcomes


def _row(outcome: Outcome) -> dict[str, object]:
    from phasebench.benchmarks.experiments.references.rows import row

    return row(outcome)


def _print_table(outcomes: list[Outcome], update: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    from phasebench.benchmarks.page.markdown import number
    from phasebench.reference.certificates.make import LIMIT

    table = Table(title=f"certified references (max norms at t_end; horizon: long double under {LIMIT:g})")
    for head in ("problem", *COLUMNS, ""):
        table.add_column(head, justify="right" if head in COLUMNS else "left", no_wrap=True)
    for r in map(_row, outcomes):
        verdict = [str(r["changed"])] if r["changed"] else []
        verdict += [f"{r['disagree']} of {r['pairs']} comparisons disagree"] if r["disagree"] else []
        cells = (number(r[column], digits) for column, digits in COLUMNS.values())
        table.add_row(str(r["problem"]), *cells, "; ".join(verdict) or "ok")
    (out if out.is_terminal else Console(width=200)).print(table)
    changed = [o.fresh.problem for o in outcomes if o.changed]
    if update:
        out.print(f"{len(outcomes)} stored, {len(changed)} of them new or changed")
    else:
        said = f"changed: {', '.join(changed)}" if changed else "nothing moved"
        out.print(f"{len(outcomes)} computed anew; {said}", highlight=False)


def _one(name: str, t_end: float, as_json: bool) -> bool:
    """Certify one time and print the state; whether the other solvers agree."""
    from phasebench.benchmarks.problems import problem
    from phasebench.reference.certificates import make
    from phasebench.reference.solvers.taylor import ReferenceFailed

    if not 0 < t_end < float("inf"):
        raise InvalidInput(f"--t-end is {t_end}; it must be a positive number")
    made = problem(name)
    try:
        new = make.certify(made, [t_end])
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
        {"solver": c.solver, "distance": c.distance, "uncertainty": c.uncertainty, "agrees": end.agrees(c)}
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
        f"uncertainty {number(end.uncertainty)} (max norm, quadruple precision); long double differs by "
        f"{number(end.long_double)}",
        f"energy changed by {number(end.energy)} of the sum of its terms",
        f"long double stays under {new.limit:g} of the state to t = {number(new.horizon, 6)}, "
        f"these digits to t = {number(new.digits_horizon, 6)}",
    ]
    for c in end.checks:
        verb = "agrees" if end.agrees(c) else "DISAGREES"
        lines.append(f"{c.solver} {verb}: distance {number(c.distance)}, its own uncertainty {number(c.uncertainty)}")
    return lines
