"""``advise``: the cheapest integration that meets an accuracy, run against a reference before it is named."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any

import typer

from .integrate import made
from .shared import (
    END_TIME,
    WRONG,
    complain,
    end_time,
    invalid_input,
    numbers,
    out,
    print_json,
    show,
    telling,
    values,
    warn,
)

#: Candidates that are shown on a terminal, and reasons for which others fell out.
SHOWN, REASONS = 10, 6


def advise(
    problem: Annotated[
        str | None,
        typer.Argument(metavar="PROBLEM", help="A problem, problem:orbit, or a file, ./my_problem.py, planets.csv."),
    ] = None,
    t_end: Annotated[str | None, typer.Option(help=END_TIME)] = None,
    accuracy: Annotated[float | None, typer.Option(help="The largest error that is allowed.")] = None,
    quantity: Annotated[
        str, typer.Option(help="Of what: end-state, trajectory, energy, or a name of the problem's own.")
    ] = "end-state",
    conserve: Annotated[
        str | None, typer.Option(help="What has to be kept: energy, symplectic, reversible, momentum, an invariant.")
    ] = None,
    budget: Annotated[
        float | None, typer.Option(help="Seconds that a run may take: advise the most accurate one.")
    ] = None,
    limit: Annotated[float | None, typer.Option(help="Seconds that the search itself may take.")] = None,
    set_: Annotated[list[str], typer.Option("--set", help="A problem's parameter: e=0.2.")] = [],  # noqa: B006
    hamiltonian: Annotated[str | None, typer.Option(help="Instead of PROBLEM, a formula of H.")] = None,
    q: Annotated[str | None, typer.Option(help="Initial coordinates: 0,0.82.")] = None,
    p: Annotated[str | None, typer.Option(help="Initial momenta: 0.1,0.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Say which integrator, at which step, holds an accuracy at the least cost; exit code 0 only where one was run."""
    from phasebench.integrators.errors import InvalidInput

    def report(reason: str) -> None:
        if as_json:
            print_json({"problem": hamiltonian or problem, "choice": None, "why": reason, "verified": False})
        else:
            complain(reason)

    with invalid_input(report):
        if problem is None and hamiltonian is None:
            raise InvalidInput("give a problem, as in: advise pendulum --t-end 100 --accuracy 1e-6")
        if t_end is None:
            raise InvalidInput("give --t-end: where does the integration end?")
        q0, p0 = numbers(q, "q"), numbers(p, "p")
        chosen = made(problem, hamiltonian, values(set_, "set"), q0, p0)
        words = _words(problem, hamiltonian, chosen, set_, q, p)
        if hamiltonian is None:
            from phasebench.benchmarks.measure.global_error import started

            chosen = started(chosen, q0, p0)
        from phasebench.benchmarks.advice.advise import advise as found
        from phasebench.benchmarks.advice.ask import ask

        with telling("advise") as tell:
            asked = ask(
                chosen,
                t_end=end_time(t_end, chosen),
                accuracy=accuracy,
                quantity_name=quantity,
                conserve=[x.strip() for x in conserve.split(",") if x.strip()] if conserve else (),
                budget=budget,
                limit=limit,
                progress=tell,
            )
            answer = found(asked, words)
    if as_json:
        print_json(answer)
    else:
        _print(answer)
    raise typer.Exit(0 if answer["choice"] and answer["verified"] else WRONG)


def _words(problem, hamiltonian, chosen, set_, q, p) -> list[str]:
    """What names the problem on a command line: as it was named here."""
    from phasebench.benchmarks.problems import file_and_orbit

    own = problem is not None and (hamiltonian is not None or file_and_orbit(problem)[0] is not None)
    words = [] if problem is None else [problem if own else chosen.label]
    words += ["--hamiltonian", hamiltonian] if hamiltonian is not None else []
    for name, value in [("--set", x) for x in set_] + [("--q", q), ("--p", p)]:
        words += [name, value] if value is not None else []
    return words


def _print(answer: dict[str, Any]) -> None:
    """The answer for a person: a table, one command to paste, and why others fell out."""
    warn(answer["warning"])
    warn(answer["shared"])
    wanted = f"{answer['quantity']} of {answer['problem']} to t = {answer['t_end']:g}"
    if answer["choice"] is None:
        out.print(f"No advice for the {wanted}: {answer['why']}.", highlight=False, markup=False, soft_wrap=True)
        _dropped(answer["dropped"])
        return
    asked = f"{answer['accuracy']:g}" if answer["budget"] is None else f"the best in {answer['budget']:g} s"
    show(f"{wanted}, error: {asked}", [_line(role, c) for role, c in _roles(answer)])
    source = answer["reference"]
    known = f"the reference ({source['source']}) is known to {source['uncertainty']:.1e}"
    second = f"; {source['second']} came within {source['distance']:.1e} of it" if source["second"] else ""
    state = "verified: run against the reference" if answer["verified"] else "NOT verified"
    out.print(f"{state}; {known}{second}", highlight=False, markup=False, soft_wrap=True)
    if answer["lower_model"]:
        from phasebench.benchmarks.advice.models import said

        out.print(said(answer["lower_model"]), highlight=False, markup=False, soft_wrap=True)
    _dropped(answer["dropped"])
    out.print(f"\n{answer['choice']['command']}", highlight=False, markup=False, soft_wrap=True)


def _roles(answer: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """(what a candidate is, the candidate), each once but for the next accuracy."""
    seen: dict[str, list[str]] = {}
    rows = {}
    named = [(role, answer[role]) for role in ("choice", "own", "peer", "runner_up")]
    for role, c in [*named, *(("", c) for c in answer["alternatives"][:SHOWN])]:
        if c is not None:
            rows[c["integrator"]] = c
            seen.setdefault(c["integrator"], []).extend([role.replace("_", " ")] if role else [])
    lines = [(", ".join(roles), rows[id]) for id, roles in seen.items()]
    further = answer["next"]
    return lines + ([(f"for {further['accuracy']:g}", further)] if further else [])


def _line(role: str, c: dict[str, Any]) -> dict[str, str]:
    size = f"tol {c['tol']:.3g}" if "tol" in c else f"h {c['h']:.4g}"
    return {
        "integrator": c["integrator"],
        "size": size,
        "error": f"{c['error']:.2g}",
        "seconds": f"{c['seconds']:.3g}",
        "": ", ".join(filter(None, [role, c.get("remark")])),
    }


def _dropped(dropped: list[dict[str, str]]) -> None:
    """How many fell out for which reason, and who was tried and did not make it."""
    kinds = Counter(_kind(d["why"]) for d in dropped)
    text = ", ".join(f"{n} {kind}" for kind, n in kinds.most_common())
    if text:
        out.print(f"not advised: {text}", highlight=False, markup=False, soft_wrap=True)
    tried = [d for d in dropped if _kind(d["why"]) in ("too slow", "failed")]
    for d in tried[:REASONS]:
        out.print(f"  {d['integrator']}: {d['why']}", highlight=False, markup=False, soft_wrap=True)


def _kind(why: str) -> str:
    """The kind of a reason."""
    if why.startswith("not tried"):
        return "not tried (dearer where measured, or no time)"
    if why.startswith("too slow"):
        return "too slow"
    if "conserv" in why or "does not keep" in why or "not symplectic" in why:
        return "not conserving what was asked"
    if "not installed" in why or "cannot be imported" in why:
        return "not installed"
    if why.startswith(("breaks", "does not get there", "its error", "fails", "diverged", "not-converged")):
        return "failed"
    return "not applicable"
