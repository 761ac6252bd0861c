"""What ``phasebench certify`` does: compute every certified reference anew and show that nothing moved.

`TIMES` is the one table of spans.  Where the flow is chaotic or unstable the span is long enough for long double's
horizon to fall inside, and short enough for the stored digits to hold to its end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators.errors import InvalidInput, unknown
from phasebench.reference.certificates import make as certification
from phasebench.reference.certificates import stored as certified
from phasebench.reference.solvers import taylor

if TYPE_CHECKING:
    from rich.console import Console

#: Decades to 1000, 200, 100: of problems whose unit of time is about a period.
LONG, MIDDLE, SHORT = (1.0, 10.0, 100.0, 1000.0), (0.2, 2.0, 20.0, 200.0), (0.1, 1.0, 10.0, 100.0)
SEASONS = (0.12, 1.2, 12.0, 120.0)
#: Ten periods of the figure eight, to its last in decades.
EIGHT = (0.0632591398, 0.632591398, 6.32591398, 63.2591398)
#: Label -> the times of its stored states.  The scenes' ends are among them; kepler's are of 1, 10, 100 periods.
TIMES: dict[str, tuple[float, ...]] = {
    "harmonic-oscillator": (1.0, 2.0, 10.0, 100.0, 1000.0),
    "pendulum:swinging": (1.0, 2.0, 10.0, 100.0, 1000.0),
    "pendulum:rotating": LONG,
    "kepler": (1.0, 2 * pi, 20 * pi, 200 * pi),
    "perturbed-kepler": LONG,
    "henon-heiles:chaotic": (1.0, 10.0, 100.0, 300.0),
    "henon-heiles:box": LONG,
    "outer-solar-system": (500.0, 5000.0, 50_000.0, 500_000.0),
    "lotka-volterra:2-2": SEASONS,
    "lotka-volterra:4-8": SEASONS,
    "lotka-volterra:4-2": SEASONS,
    "lotka-volterra:6-2": SEASONS,
    "lotka-volterra-log:2-2": SEASONS,
    "lotka-volterra-log:4-8": SEASONS,
    "lotka-volterra-log:4-2": SEASONS,
    "lotka-volterra-log:6-2": SEASONS,
    "fpu": (0.2, 2.0, 20.0, 200.0),
    "nls:plane-wave": (0.1, 1.0, 10.0),
    "nls:soliton": (0.1, 1.0, 5.0),
    "klein-gordon": (0.1, 1.0, 10.0),
    "double-pendulum:chaotic": SHORT,
    "double-pendulum:regular": SHORT,
    "duffing:one-well": MIDDLE,
    "duffing:near-separatrix": MIDDLE,
    "duffing:both-wells": MIDDLE,
    "quadrupole-boson:benchmark": SHORT,
    "quadrupole-boson:h20": (0.1, 1.0, 10.0, 60.0),
    "figure-eight": EIGHT,
    "toda:three": SHORT,
    "toda:cnoidal": SHORT,
    "rigid-body:around-e3": MIDDLE,
    "rigid-body:around-e1": MIDDLE,
    "rigid-body:near-separatrix": MIDDLE,
    "charged-particle": LONG,
    "schwarzschild:precessing": LONG,
    "schwarzschild:zoom-whirl": (1.0, 10.0, 100.0, 1000.0, 2000.0),
    "schwarzschild:isco": LONG,
    "schwarzschild:photon-sphere": (0.1, 1.0, 10.0, 40.0),
    "lennard-jones": (0.1, 1.0, 10.0),
    "n-body": (1.0, 10.0, 15.0, 16.0, 30.0),
}


@dataclass(frozen=True)
class Outcome:
    """A reference computed anew beside the stored one (None: there is none), and how far its states moved.

    ``moved`` is the largest distance between a stored and a fresh state, ``allowed`` what their uncertainties allow
    there; ``changed`` says in words what is not as stored, and is empty where nothing moved.
    """

    stored: certified.Certificate | None
    fresh: certified.Certificate
    moved: float
    allowed: float
    changed: str


def labels() -> list[str]:
    """Every problem with each of its orbits, as `Problem.label` says it."""
    return [id if len(orbits) == 1 else f"{id}:{o}" for id, (_, _, orbits) in PROBLEMS.items() for o in orbits]


def chosen(names: Iterable[str]) -> list[str]:
    """The labels that names stand for: a label, or an id for all of its orbits; all where none is named.

    Raises
    ------
    InvalidInput
        For an unknown problem or orbit, or one without times in `TIMES`.
    """
    every, found = labels(), []
    for name in names:
        id = name.partition(":")[0]
        if id not in PROBLEMS:
            raise unknown("problem", id, PROBLEMS)
        same = [x for x in every if x.partition(":")[0] == id and (":" not in name or name in (x, f"{id}:{_orbit(x)}"))]
        if not same:
            raise unknown(f"orbit of '{id}'", name.partition(":")[2], PROBLEMS[id][2])
        found += [x for x in same if x not in found]
    found = found or every
    missing = [x for x in found if x not in TIMES]
    if missing:
        raise InvalidInput(f"no times are chosen for {', '.join(missing)}; add them to TIMES in benchmarks/certify.py")
    return found


def _orbit(label: str) -> str:
    id, _, orbit = label.partition(":")
    return orbit or PROBLEMS[id][2][0]


def stored(label: str) -> certified.Certificate | None:
    """The stored certificate of a label at the problem's default parameters."""
    return certified.find(problem(label))


def compare(old: certified.Certificate | None, new: certified.Certificate) -> Outcome:
    """What moved between a stored certificate and a fresh one."""
    if old is None:
        return Outcome(None, new, float("nan"), float("nan"), "not stored")
    if [e.t for e in old.ends] != [e.t for e in new.ends]:
        return Outcome(old, new, float("nan"), float("nan"), "stored at other times")
    pairs = [certification.moved(a, b) for a, b in zip(old.ends, new.ends, strict=True)]
    late = [e.t for e, (far, may) in zip(new.ends, pairs, strict=True) if not far <= may]
    worst = max(pairs, key=lambda pair: pair[0] / pair[1])
    return Outcome(old, new, *worst, f"moved at t = {', '.join(f'{t:g}' for t in late)}" if late else "")


def renew(label: str) -> Outcome:
    """Compute a label's certificate and compare it with the stored one.

    Raises
    ------
    InvalidInput
        Where the stored file cannot be trusted or its problem has changed.
    """
    return compare(stored(label), certification.certify(problem(label), TIMES[label]))


def keep(new: certified.Certificate) -> None:
    """Store a certificate in its problem's file, in place of the one of the same orbit and parameters."""
    id = new.problem.partition(":")[0]
    try:
        others, _ = certified.read(id)
    except InvalidInput:
        others = ()
    kept = {(c.problem, tuple(c.parameters.items())): c for c in others if c.problem in labels()}
    kept[new.problem, tuple(new.parameters.items())] = new
    order = {label: i for i, label in enumerate(labels())}
    certified.write(id, sorted(kept.values(), key=lambda c: order[c.problem]), certification.versions())


def row(outcome: Outcome) -> dict[str, object]:
    """A line of the command's table and of the report."""
    new = outcome.fresh
    last = new.ends[-1]
    first = last.checks[0]
    return {
        "problem": new.problem,
        "t_end": new.t_end,
        "states": len(new.ends),
        "limit": new.limit,
        "uncertainty": last.uncertainty,
        "long double": last.long_double,
        "horizon": new.horizon,
        "holds to the end": new.horizon == new.t_end,
        "digits hold to the end": new.digits_horizon == new.t_end,
        "growth": new.growth,
        "rate": new.rate,
        "energy": max(abs(e.energy) for e in new.ends),
        "second solver": first.solver,
        "distance": first.distance,
        "its uncertainty": first.uncertainty,
        "other solvers": ", ".join(f"{c.solver}: {c.distance:.2g} (own {c.uncertainty:.2g})" for c in last.checks[1:]),
        "disagree": sum(not e.agrees(c) for e in new.ends for c in e.checks),
        "pairs": sum(len(e.checks) for e in new.ends),
        "moved by": outcome.moved,
        "allowed": outcome.allowed,
        "changed": outcome.changed,
    }


def certify(
    names: Iterable[str] = (),
    update: bool = False,
    t_end: float | None = None,
    console: Console | None = None,
    progress: Console | None = None,
    make: Callable[[str], Outcome] | None = None,
) -> int:
    """The command ``phasebench certify``; returns its exit code, 1 where a reference moved or solvers disagree.

    Parameters
    ----------
    names : labels or ids of problems; all where none is named
    update : store what was computed, problem by problem, so that a run that is killed loses nothing
    t_end : certify this one time of one problem, print the state and store nothing
    console, progress : where the table and the progress go
    make : label -> `Outcome`, `renew` by default

    Raises
    ------
    InvalidInput
        For an unknown name, a time that is no positive number, or a stored file that cannot be trusted (not while
        updating).
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console, progress = console or Console(), progress or Console(stderr=True)
    if t_end is not None:
        names = list(names)
        if len(names) != 1 or update:
            raise InvalidInput("--t-end certifies one problem and stores nothing: name one, as id or id:orbit")
        return _one(names[0], t_end, console)
    todo = chosen(names)
    outcomes = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=progress) as bars:
        bar = bars.add_task("certify", total=len(todo))
        for label in todo:
            bars.update(bar, description=label)
            if update:
                outcome = _updated(label, make)
                keep(outcome.fresh)
            else:
                outcome = (make or renew)(label)
            outcomes.append(outcome)
            bars.update(bar, advance=1)
    _print(outcomes, update, console)
    wrong = [o for o in outcomes if not all(e.agree for e in o.fresh.ends) or (o.changed and not update)]
    return 1 if wrong else 0


def _updated(label: str, make) -> Outcome:
    """As `renew`, but a stored file that cannot be trusted counts as none."""
    try:
        stored(label)
    except InvalidInput:
        return compare(None, certification.certify(problem(label), TIMES[label]))
    return (make or renew)(label)


def _print(outcomes: list[Outcome], update: bool, console: Console) -> None:
    from rich.console import Console
    from rich.table import Table

    from phasebench.benchmarks.page.markdown import number

    heads = ("problem", "t_end", "uncertainty", "long double", "horizon", "second solver", "its own", "moved by", "")
    table = Table(
        title=f"certified references (max norms at t_end; horizon: long double under {certification.LIMIT:g})"
    )
    for i, head in enumerate(heads):
        table.add_column(head, justify="left" if i in (0, len(heads) - 1) else "right", no_wrap=True)
    for o in outcomes:
        r = row(o)
        verdict = [o.changed] if o.changed else []
        verdict += [f"{r['disagree']} of {r['pairs']} comparisons disagree"] if r["disagree"] else []
        cells = ("t_end", "uncertainty", "long double", "horizon", "distance", "its uncertainty", "moved by")
        table.add_row(
            str(r["problem"]), *(number(r[c], 4 if c in cells[::3] else 2) for c in cells), "; ".join(verdict) or "ok"
        )
    (console if console.is_terminal else Console(width=200, file=console.file)).print(table)
    changed = [o.fresh.problem for o in outcomes if o.changed]
    if update:
        console.print(f"{len(outcomes)} stored, {len(changed)} of them new or changed")
    else:
        said = f"changed: {', '.join(changed)}" if changed else "nothing moved"
        console.print(f"{len(outcomes)} computed anew; {said}", highlight=False)


def _one(label: str, t_end: float, console: Console) -> int:
    """Certify one time and print the state."""
    from phasebench.benchmarks.page.markdown import number

    if not 0 < t_end < float("inf"):
        raise InvalidInput(f"--t-end is {t_end}; it must be a positive number")
    try:
        made = problem(label)
        label, new = made.label, certification.certify(made, [t_end])
    except taylor.ReferenceFailed as error:
        raise InvalidInput(f"{label} cannot be certified to {t_end!r}: {error}") from None
    (found,) = new.ends
    lines = [f"{label} at t = {found.t!r}"]
    for name, texts in (("q", found.q_text), ("p", found.p_text)):
        lines += [f"  {name}{i} = {x}" for i, x in enumerate(texts, 1)]
    lines += [
        f"uncertainty {number(found.uncertainty)} (max norm, quadruple precision); long double differs by "
        f"{number(found.long_double)}",
        f"energy changed by {number(found.energy)} of the sum of its terms",
        f"long double stays under {new.limit:g} of the state to t = {number(new.horizon, 6)}, "
        f"these digits to t = {number(new.digits_horizon, 6)}",
    ]
    for c in found.checks:
        verb = "agrees" if found.agrees(c) else "DISAGREES"
        lines.append(f"{c.solver} {verb}: distance {number(c.distance)}, its own uncertainty {number(c.uncertainty)}")
    console.print("\n".join(lines), highlight=False, soft_wrap=True, markup=False)
    return 0 if found.agree else 1
