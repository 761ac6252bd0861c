"""``advise``: name the cheapest integration that meets an accuracy, after running it against a reference solution."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options
from .integrate import made
from .shared import WRONG, complain, invalid_input, numbers, out, print_json, say, show, telling, time_of, values, warn

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

#: The most candidates shown on a terminal, and the most reasons why others were dropped.
SHOWN, REASONS = 10, 6
NOT_INSTALLED, TIE = "not installed", "tie with the choice"


def advise(
    problem: options.Problem = None,
    t_end: options.EndTime = None,
    accuracy: Annotated[
        float | None, typer.Option(metavar="NUMBER", help="The largest error that is allowed, in the quantity's unit.")
    ] = None,
    quantity: Annotated[str, options.quantity()] = "end-state",
    conserve: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What has to be kept: energy, symplectic, reversible, momentum, an invariant; commas between.",
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Instead of an accuracy, what the integration may cost: the most accurate one is named.",
        ),
    ] = None,
    time_limit: Annotated[
        float | None,
        options.time_limit(
            "It ends with what it has found by then, and says if that is incomplete. Default, for the search alone: 3, "
            "or 50 if no measurements of the problem are stored; longer if promising methods have to be compiled first."
        ),
    ] = None,
    set_: options.Settings = [],  # noqa: B006
    hamiltonian: options.Formula = None,
    constraint: options.Constraints = [],  # noqa: B006
    part: options.Parts = [],  # noqa: B006
    q: options.Coordinates = None,
    p: options.Momenta = None,
    why: Annotated[bool, typer.Option("--why", help="List every integrator that fell out, and why.")] = False,
    as_json: options.Json = False,
) -> None:
    """Recommend the integrator and step that meet an accuracy at the least cost; exit code 0 only if it is verified."""
    from phasebench.integrators.errors import InvalidInput

    def report(reason: str) -> None:
        if as_json:
            print_json({"problem": hamiltonian or problem, "choice": None, "why": reason, "verified": False})
        else:
            complain(reason)

    since = time.perf_counter()
    with invalid_input(report):
        if problem is None and hamiltonian is None:
            raise InvalidInput("give a problem, as in: advise pendulum --t-end 100 --accuracy 1e-6")
        if t_end is None:
            raise InvalidInput("give --t-end: where does the integration end?")
        q0, p0 = numbers(q, "q"), numbers(p, "p")
        chosen = made(problem, hamiltonian, values(set_, "set"), q0, p0, constraint, part)
        words = _words(problem, hamiltonian, chosen, set_, q, p, constraint, part)
        if hamiltonian is None:
            from phasebench.benchmarks.measure.global_error import with_start

            chosen = with_start(chosen, q0, p0)
        from phasebench.benchmarks.advice.advise import advise as found
        from phasebench.benchmarks.advice.ask import ask

        with telling("advise") as tell:
            asked = ask(
                chosen,
                t_end=time_of(t_end, chosen),
                accuracy=accuracy,
                quantity_name=quantity,
                conserve=[x.strip() for x in conserve.split(",") if x.strip()] if conserve else (),
                budget=budget,
                limit=time_limit,
                progress=tell,
                since=since,
            )
            answer = found(asked, words)
    if as_json:
        print_json(answer)
    else:
        _print(answer, why)
    raise typer.Exit(0 if answer["choice"] and answer["verified"] else WRONG)


def _words(
    problem: str | None,
    hamiltonian: str | None,
    chosen: Problem,
    set_: Sequence[str],
    q: str | None,
    p: str | None,
    constraints: Sequence[str] = (),
    parts: Sequence[str] = (),
) -> list[str]:
    from phasebench.benchmarks.problems import file_and_orbit

    own = problem is not None and (hamiltonian is not None or file_and_orbit(problem)[0] is not None)
    words = [] if problem is None else [problem if own else chosen.label]
    words += ["--hamiltonian", hamiltonian] if hamiltonian is not None else []
    words += [word for g in constraints for word in ("--constraint", g)]
    words += [word for part in parts for word in ("--part", part)]
    for name, value in [("--set", x) for x in set_] + [("--q", q), ("--p", p)]:
        words += [name, value] if value is not None else []
    return words


def _print(answer: dict[str, Any], why: bool = False) -> None:
    """Print the answer of `advise` (the dict of --json) as a table, a command to paste, and why others were dropped.

    With ``why`` the reason of each dropped integrator is printed, else their number for each kind of reason.
    """
    warn(answer["warning"])
    warn(answer["shared"])
    wanted = f"{answer['quantity']} of {answer['problem']} to t = {answer['t_end']:g}"
    if answer["choice"] is None:
        why_not = f"{'incomplete: ' if answer['incomplete'] else ''}{answer['why']}"
        say(f"No advice for the {wanted}: {why_not}.")
        _dropped(answer["dropped"], why)
        return
    for note in answer["notes"]:
        warn(note)
    asked = f"{answer['accuracy']:g}" if answer["budget"] is None else f"the best in {answer['budget']:g} s"
    orbit = answer["choice"]["end_state_error"] is not None
    show(f"{wanted}, error: {asked}", [_line(role, c, orbit) for role, c in _roles(answer)])
    source = answer["reference"]
    state = "verified: run against the reference" if answer["verified"] else "NOT verified"
    if source["uncertainty"]:
        state += f"; the reference ({source['source']}) is known to {source['uncertainty']:.1e}"
        state += f"; {source['second']} came within {source['distance']:.1e} of it" if source["second"] else ""
    elif answer["verified"]:
        state = "verified: run again; a conserved quantity is compared with its own start"
    state += "; incomplete" if answer["incomplete"] else ""
    say(state)
    if answer["lower_model"]:
        from phasebench.benchmarks.advice.models import summarize

        say(summarize(answer["lower_model"]))
    _dropped(answer["dropped"], why)
    say(f"\n{answer['choice']['command']}")


def _roles(answer: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """The printed rows of an answer: (text of the roles such as "choice, own", the integration), the choice first."""
    seen: dict[str, list[str]] = {}
    rows = {}
    named = [(role, answer[role]) for role in ("choice", "own", "peer", "runner_up")]
    for role, c in [*named, *(("", c) for c in answer["alternatives"][:SHOWN])]:
        if c is not None:
            rows[c["integrator"]] = c
            seen.setdefault(c["integrator"], []).extend([role.replace("_", " ")] if role else [])
    first = answer["choice"]["integrator"]
    lines = [(", ".join([*roles, *([TIE] if rows[id].get("tie") else [])]), rows[id]) for id, roles in seen.items()]
    by = "seconds" if answer["budget"] is None else "error"
    lines.sort(key=lambda line: (line[1]["integrator"] != first, line[1][by]))
    further = answer["next"]
    return lines + ([(f"for {further['accuracy']:g}", further)] if further else [])


def _line(role: str, c: dict[str, Any], orbit: bool) -> dict[str, str]:
    off = c.get("end_state_error")
    size = f"tol {c['tol']:.3g}" if "tol" in c else f"h {c['h']:.4g}"
    return {
        "integrator": c["integrator"],
        "size": size,
        "error": f"{c['error']:.2g}",
        **({"end state off by": "" if off is None else f"{off:.2g}"} if orbit else {}),
        "seconds": f"{c['seconds']:.3g}",
        "": ", ".join(filter(None, [role, c.get("remark")])),
    }


def can_be_installed(candidate: dict[str, str]) -> bool:
    """True unless the package of a dropped peer needs a newer Python than this one."""
    from phasebench.reference.peers.record import older_python
    from phasebench.reference.peers.registry import BY_ID

    return older_python(BY_ID[candidate["integrator"]].python) is None


def _dropped(dropped: list[dict[str, str]], each: bool) -> None:
    """Print how many integrators were dropped for which kind of reason, and ``each``, or some, with its reason."""
    kinds = Counter(_kind(d["why"]) for d in dropped)
    text = ", ".join(f"{n} {kind}" for kind, n in kinds.most_common())
    if text:
        say(f"not advised: {text}")
    missing = {d["why"].split()[0] for d in dropped if _kind(d["why"]) == NOT_INSTALLED and can_be_installed(d)}
    if missing:
        from phasebench.reference.native import LIBRARIES

        ways = [LIBRARIES[name].install for name in sorted(missing & LIBRARIES.keys())]
        packages = " ".join(sorted(missing - LIBRARIES.keys()))
        ways += [f"pip install {packages}"] if packages else []
        say(f"to try those, too: {'; '.join(ways)}")
    if each:
        for d in sorted(dropped, key=lambda d: (_kind(d["why"]), d["integrator"])):
            say(f"  {d['integrator']}: {d['why']}")
        return
    if text:
        out.print("--why lists them all", highlight=False, markup=False)
    tried = [d for d in dropped if _kind(d["why"]) in ("too slow", "failed")]
    for d in tried[:REASONS]:
        say(f"  {d['integrator']}: {d['why']}")


def _kind(why: str) -> str:
    if why.startswith("not tried"):
        return "not tried (dearer where measured, or no time)"
    if why.startswith("too slow"):
        return "too slow"
    if "conserv" in why or "does not keep" in why or "not symplectic" in why:
        return "not conserving what was asked"
    if "not installed" in why or "cannot be imported" in why:
        return NOT_INSTALLED
    if why.startswith(("breaks", "does not get there", "its error", "fails", "diverged", "not-converged")):
        return "failed"
    return "not applicable"
