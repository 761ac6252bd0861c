"""Measure all properties of an integrator for its certificate, in turn; last, whether it remembers earlier calls."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Protocol

from phasebench.benchmarks.judge import judge
from phasebench.benchmarks.judge.checks import CHECKS, PRECISIONS
from phasebench.benchmarks.judge.evidence import Tables, agrees, shows_structure
from phasebench.benchmarks.judge.requirements import stateless
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision

from . import adaptive, battery, behaviour, conservation, repeats, structure
from .battery import Entry
from .jumps import jumps
from .order import order
from .place import place, scenes
from .place import run_subject as placed
from .scaled import sweep
from .states import states
from .stepping import DIGITS, StepFailed, Stepper
from .structure import DEFECTS
from .subject import Subject
from .times import timed_or_failed

#: The trait of the systems on which volume is measured without a claim.
MAGNETIC = "magnetic"
#: Why steps on constraints are measured in doubles.
ON_MANIFOLD = "a step on constraints solves for multipliers"

#: The optional measures.
EVERYTHING = {*DEFECTS, "stability", "long", "round_off", "place"}
#: Measures made on systems and scenes of the suite only, not on a user's own problem.
ELSEWHERE = {"stability", "place"}
#: The largest relative distance of a step in doubles from the one in many digits; beyond it, doubles are measured.
OTHERWISE = 1e-11


class Run(Protocol):
    """The state of a certification, which the measuring functions read and to whose tables they add.

    Attributes
    ----------
    seed : of the drawn systems and states
    alone : True if only what the method claims is measured
    tables : the rows measured so far, to which each measuring function adds its own
    doubles : why the method ran in double precision only; "" if it did not
    """

    seed: int
    alone: bool
    tables: Tables
    doubles: str


def fill_tables(chosen: Subject, run: Run, own: list[Entry], tell: Callable[[str], None]) -> list[dict]:
    """Measure an integrator and fill the tables of its certification ``run``.

    ``own`` are the user's own problems as entries, measured in place of the battery; ``tell`` is called with the name
    of each measure.  Returns a row for each scene (problem and span) on which the integrator was timed: its time
    relative to the fastest stored integrator.
    """
    tables, times = run.tables, []
    if chosen.integrator is not None and not getattr(chosen.integrator.record, "one_step", True):
        why = "it is a multistep method: it needs earlier states, which a step (system, q, p, h) does not have"
        tables.failed |= {"runs": why, "all": why}
        return times
    heard, calls = repeats.listening(chosen, run.seed)
    claimed = [CHECKS[name] for name in chosen.own.claims]
    wanted = {x for check in claimed for x in (check.measure, *check.needs)} if run.alone else set(EVERYTHING)
    wanted -= ELSEWHERE if own else set()
    charged = MAGNETIC in chosen.own.requires
    if not charged and "volume" not in chosen.own.claims:
        wanted.discard("volume")
    special = next((of for trait, of in battery.BY_TRAIT.items() if trait in chosen.own.requires), None)
    battery_of = special or battery.entries
    entries = _able(chosen, own or battery_of(), tables)
    if any(entry.system.constrained for entry in entries):
        wanted.discard("volume")
        tables.failed["volume"] = "on a manifold, volume is not measured"
    run.doubles = "an adaptive integrator has no step" if chosen.adaptive else ""
    try:
        if chosen.adaptive:
            _adaptive(chosen, entries, tables, run.seed, tell)
            if not run.alone and not own:
                _place(chosen, tables, tell)
        else:
            several = [e for e in special() if e.lasting] if special else battery.lasting()
            lasting = _able(chosen, own or several, tables) if "long" in wanted else []
            run.doubles = _step(heard, tables, run.seed, tell, wanted, entries, lasting)
        times = _times(chosen, tables, tell)
    except StepFailed as failure:
        tables.failed["raised"] = str(failure)
    if not chosen.adaptive:
        _state(heard, calls, entries, tables, run.seed, tell)
        if chosen.integrator is None and special is None and not own:
            _sweep(chosen, entries, tables, run.seed, tell, calls.count)
    return times


def _able(chosen: Subject, entries: Iterable[Entry], tables: Tables) -> list[Entry]:
    entries = list(entries)
    able = [e for e in entries if chosen.lacks(e.system) is None]
    if not able:
        why = next(filter(None, (chosen.lacks(e.system) for e in entries)), "there is no system")
        tables.failed["runs"] = f"none of the systems is of the kind that it requires: {why}"
    return able


def _step(
    chosen: Subject,
    tables: Tables,
    seed: int,
    tell: Callable[[str], None],
    wanted: set[str],
    entries: list[Entry],
    lasting: list[Entry],
) -> str:
    """Measure a step on ``entries``, its long runs on ``lasting``, and fill the tables.

    ``wanted`` are names of the measures to make.  Returns why the step was measured in doubles only, or "" if it was
    measured in many digits.
    """
    if not entries:
        return ""
    tell("first steps")
    tables.rows["runs"] = behaviour.runs(chosen, entries, seed)
    if any(r["status"] != "ok" for r in tables.rows["runs"]):
        tables.failed["all"] = "it does not run"
        return ""
    tell("what it does to its input")
    tables.rows["input"] = behaviour.input_changed(chosen, entries, seed)
    tell("whether it takes many digits")
    doubles = ON_MANIFOLD if entries[0].system.constrained else behaviour.arithmetic(chosen, entries, seed)
    arithmetics = (DOUBLE,) if doubles else (MULTIPRECISION, DOUBLE)
    tables.rows["rounding"] = behaviour.rounding(chosen, entries, seed)
    chosen = _rounding(chosen, tables)
    tell("errors from small and large states")
    tables.rows["states"] = _first_that_runs(lambda a: states(chosen, entries, seed, a), arithmetics)
    other = next((r for r in tables.rows["states"] if r["doubles"] > OTHERWISE), None)
    if other is not None:
        # Its number of sub-steps depends on rounding, or it inspects the type of its arguments.
        doubles = f"on {other['on']} it is another step in many digits: {other['doubles']:.1e} apart"
        arithmetics = (DOUBLE,)
        tables.rows["states"] = states(chosen, entries, seed, DOUBLE)
    for entry in entries:
        tell(f"order on {entry.name}")
        row = _first_that_runs(lambda a, e=entry: order(Stepper(chosen, e, a), seed), arithmetics)
        tables.rows.setdefault("order", []).append(row | {"separable": entry.system.separable})
    tables.done |= {"order", "consistent"}
    _exchange(chosen, entries, tables, seed, arithmetics[0])
    for name in (name for name in DEFECTS if name in wanted):
        tell(name)
        for entry in entries:
            if entry.reversible or name != "reversible":
                row = _structure(chosen, entry, seed, DEFECTS[name], arithmetics)
                tables.rows.setdefault(name, []).append(row | {"separable": entry.system.separable})
        if name == "symplectic" and chosen.own.claims.get(name):
            _finer(chosen, entries, tables.of(name), seed)
        tables.done.add(name)
    if "symplectic" in wanted:
        tell("jumps of the map")
        floors = {r["on"]: r["floor"] for r in tables.of("symplectic") if r.get("arithmetic") == DOUBLE}
        unheard = repeats.unheard(chosen)
        tables.rows["jumps"] = [jumps(unheard, entry, seed, floors.get(entry.name, 0.0)) for entry in entries]
        tables.done.add("jumps")
    if "stability" in wanted and chosen.lacks(battery.oscillator().system) is None:
        tell("stability")
        tables.rows["stability"] = [behaviour.stability(chosen)]
        tables.done.add("stability")
    for entry in lasting:
        tell(f"a long run on {entry.name}")
        tables.rows.setdefault("long", []).append(conservation.long_run(chosen, entry, seed))
    tables.done.add("long")
    if "round_off" in wanted and not doubles:
        rounded = conservation.round_off(chosen, entries[min(1, len(entries) - 1)], seed)
        tables.rows["round_off"] = [rounded] if rounded else []
    if "place" in wanted:
        _place(chosen, tables, tell)
    return doubles


def _rounding(chosen: Subject, tables: Tables) -> Subject:
    """The integrator with its measured rounding, if that is of single precision."""
    coarse = max((r["value"] for r in tables.of("rounding")), default=0.0)
    return replace(chosen, eps=coarse) if PRECISIONS["double"] < coarse <= PRECISIONS["single"] else chosen


def _sweep(
    chosen: Subject, entries: list[Entry], tables: Tables, seed: int, tell: Callable[[str], None], calls: int
) -> None:
    """Compare a step that keeps nothing between ``calls`` with itself in other units; add the rows to ``tables``."""
    if tables.failed.keys() & {"raised", "all"} or stateless(tables).verdict != HOLDS:
        return
    tell("the same in other units")
    found, broken, reach = sweep(_rounding(chosen, tables), entries, seed, [n for n in DEFECTS if tables.of(n)])
    tables.rows["states"] += found
    for name, row in broken.items():
        tables.rows[name].append(row)
    tables.rows |= {"reach": [reach | {"calls": calls}]} if reach else {}


def _exchange(chosen: Subject, entries: list[Entry], tables: Tables, seed: int, arithmetic: str) -> None:
    """Where a splitting is not of its claimed order, measure it with drifts and kicks exchanged, as a hint."""
    claimed = chosen.own.claims.get("order")
    if claimed is None or chosen.own.exchanged is None or tables.failed:
        return
    if judge.judgement(CHECKS["order"], claimed, tables).verdict != CONTRADICTED:
        return
    says, step = chosen.own.exchanged
    other = replace(chosen, own=replace(chosen.own, step=step))
    rows = [order(Stepper(other, e, arithmetic), seed) for e in entries[:2]]
    if all(agrees(r, claimed) for r in rows):
        for row in tables.rows["order"]:
            row["hint"] = f"; with {says} it is"


def _finer(chosen: Subject, entries: list[Entry], rows: list[dict], seed: int) -> None:
    """Measure the largest broken defect at a quarter of its h, too, which tells why it is broken."""
    bad = [r for r in rows if shows_structure(r) is False]
    if not bad:
        return
    worst = max(bad, key=lambda r: r["value"])
    entry = next(e for e in entries if e.name == worst["on"])
    with contextlib.suppress(StepFailed), precision(DIGITS):
        stepper = Stepper(chosen, entry, worst["arithmetic"])
        worst["finer"] = structure.row_at(stepper, seed, worst["h"] / entry.unit / 4, structure.symplecticity)


def _state(
    chosen: Subject, calls: repeats.Calls, entries: list[Entry], tables: Tables, seed: int, tell: Callable[[str], None]
) -> None:
    """Measure whether a step remembers earlier calls, and add the rows to ``tables``.

    This comes after all other measures of the same step object, whose recorded ``calls`` are repeated here; ``tell`` is
    called with the name of the measure.
    """
    if any(r["status"] != "ok" for r in tables.of("runs")) or not tables.of("runs"):
        return
    tell("what it keeps between calls")
    try:
        rows = behaviour.state_between_steps(chosen, entries, seed)
        tables.rows["state"] = [*rows, *repeats.repeat_calls(chosen, calls)]
    except StepFailed as failure:
        tables.failed.setdefault("raised", str(failure))


def _place(chosen: Subject, tables: Tables, tell: Callable[[str], None]) -> None:
    """Compare an integrator's gradient evaluations with the fewest stored at the same error; add rows to ``tables``.

    Nothing is compared if the integrator does not run or is not consistent (`judge.gross_failure`).
    """
    if judge.gross_failure(judge.judgements({}, tables)):
        return
    for scene in scenes(chosen):
        tell(f"its place on {scene}")
        tables.rows.setdefault("place", []).append(place(chosen, scene))


def _times(chosen: Subject, tables: Tables, tell: Callable[[str], None]) -> list[dict]:
    """Time an integrator on the scenes (problem and span) on which its gradient evaluations were compared.

    Returns a row for each scene (see `times.times_row`): at each error that the integrator meets, its time over that of
    the fastest stored integrator.  Scenes without stored times are left out.
    """
    out = []
    for row in tables.of("place"):
        tell(f"its time on {row['on']}")
        out.append(timed_or_failed(chosen, row, placed))
    return [x for x in out if x is not None]


def _first_that_runs(measure: Callable[[str], dict], arithmetics: Sequence[str]) -> dict:
    """Return ``measure(arithmetic)`` for the first of the arithmetics that the step accepts.

    StepFailed is raised only if the last arithmetic fails, too.
    """
    for arithmetic in arithmetics[:-1]:
        try:
            return measure(arithmetic)
        except StepFailed:
            continue
    return measure(arithmetics[-1])


def _structure(
    chosen: Subject, entry: Entry, seed: int, defect: Callable[..., tuple[float, float]], arithmetics: Sequence[str]
) -> dict:
    try:
        return _first_that_runs(lambda a: structure.structure_row(Stepper(chosen, entry, a), seed, defect), arithmetics)
    except StepFailed as failure:
        if defect is not structure.symmetry:
            raise
        # A step need not accept a negative h.
        return {"on": entry.name, "status": "failed", "reason": f"with -h: {failure}"}


def _adaptive(chosen: Subject, entries: list[Entry], tables: Tables, seed: int, tell: Callable[[str], None]) -> None:
    tables.failed["all"] = "an adaptive integrator has no step map of constant h to test"
    for entry in entries:
        tell(f"tolerances on {entry.name}")
        try:
            row = adaptive.tolerances(chosen, entry, seed)
        except adaptive.InputChanged:
            tables.rows.setdefault("input", []).append({"on": entry.name, "value": 1.0, "later": 0.0})
            continue
        except adaptive.Unknown as unknown:
            tables.failed["tolerance"] = str(unknown)
            continue
        tables.rows.setdefault("runs", []).append({"on": entry.name, "status": "ok", "reason": ""})
        tables.rows.setdefault("input", []).append({"on": entry.name, "value": 0.0, "later": 0.0})
        same = {"on": entry.name, "what": "the same run twice", "value": 0.0 if row["repeats"] else 1.0}
        tables.rows.setdefault("state", []).append(same)
        tables.rows.setdefault("tolerance", []).append(row)
