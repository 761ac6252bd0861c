"""What is measured of an integrator, in the order in which it is: what it keeps between calls comes last."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from phasebench.integrators.engine.codegen import DOUBLE, MULTIPRECISION

from . import adaptive, battery, behaviour, conservation, judge, repeats, structure
from .battery import Entry
from .jumps import jumps
from .order import order
from .place import measured as placed
from .place import place, scenes
from .states import states
from .stepping import StepFailed, Stepper
from .subject import Subject
from .times import timed_or_failed
from .verdicts import CONSERVED, Tables

DEFECTS = {
    "symplectic": structure.symplecticity,
    "symmetric": structure.symmetry,
    "reversible": structure.reversibility,
}

#: Claim -> the measure that judges it, where that is of another name; and all measures but those that are always made.
MEASURE = dict.fromkeys(CONSERVED, "long")
EVERYTHING = {*DEFECTS, "stability", "long", "round_off", "place"}
#: What is measured on systems and scenes of the suite alone, not on one's own problem.
ELSEWHERE = {"stability", "place"}
#: A step in doubles is that in many digits but for this part of the state, or it is measured in doubles.
OTHERWISE = 1e-8


class Run(Protocol):
    """What a measurement is told and fills: which seed, whether what is claimed alone, its tables, its arithmetic."""

    seed: int
    alone: bool
    tables: Tables
    doubles: str


def measured(chosen: Subject, run: Run, own: list[Entry], tell) -> list[dict]:
    """Fill the tables of a run; the times beside the fastest stored."""
    tables, times = run.tables, []
    heard, calls = repeats.listening(chosen, run.seed)
    wanted = {MEASURE.get(name, name) for name in chosen.own.claims} if run.alone else set(EVERYTHING)
    wanted |= {"long"} if "symplectic" in wanted else set()  # a drift speaks against it
    wanted -= ELSEWHERE if own else set()
    entries = _able(chosen, own or battery.entries(), tables)
    run.doubles = "an adaptive integrator has no step" if chosen.adaptive else ""
    try:
        if chosen.adaptive:
            _adaptive(chosen, entries, tables, run.seed, tell)
            if not run.alone and not own:
                _place(chosen, tables, tell)
        else:
            lasting = _able(chosen, own or battery.lasting(), tables) if "long" in wanted else []
            run.doubles = _step(heard, tables, run.seed, tell, wanted, entries, lasting)
        times = _times(heard, tables, tell)
    except StepFailed as failure:
        tables.failed["raised"] = str(failure)
    if not chosen.adaptive:
        _state(heard, calls, entries, tables, run.seed, tell)
    return times


def _able(chosen: Subject, entries, tables: Tables) -> list[Entry]:
    able = [e for e in entries if chosen.lacks(e.system) is None]
    if not able:
        tables.failed["runs"] = (
            f"the battery has no system of the kind that it requires: {', '.join(chosen.own.requires)}"
        )
    return able


def _step(chosen: Subject, tables: Tables, seed: int, tell, wanted, entries, lasting) -> str:
    """Fill the tables of a step; why it was measured in doubles alone, or ""."""
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
    doubles = behaviour.arithmetic(chosen, entries, seed)
    arithmetics = (DOUBLE,) if doubles else (MULTIPRECISION, DOUBLE)
    tell("errors from small and large states")
    tables.rows["states"] = _first_that_runs(lambda a: states(chosen, entries, seed, a), arithmetics)
    other = next((r for r in tables.rows["states"] if r["doubles"] > OTHERWISE), None)
    if other is not None:
        # A number of sub-steps that is rounded otherwise, or a step that asks with what it is called.
        doubles = f"on {other['on']} it is another step in many digits: {other['doubles']:.1e} apart"
        arithmetics = (DOUBLE,)
        tables.rows["states"] = states(chosen, entries, seed, DOUBLE)
    for entry in entries:
        tell(f"order on {entry.name}")
        row = _first_that_runs(lambda a, e=entry: order(Stepper(chosen, e, a), seed), arithmetics)
        tables.rows.setdefault("order", []).append(row | {"separable": entry.system.separable})
    tables.done |= {"order", "consistent"}
    for name in (name for name in DEFECTS if name in wanted):
        tell(name)
        for entry in entries:
            if entry.reversible or name != "reversible":
                row = _structure(chosen, entry, seed, DEFECTS[name], arithmetics)
                tables.rows.setdefault(name, []).append(row | {"separable": entry.system.separable})
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
        tables.rows["round_off"] = [conservation.round_off(chosen, entries[min(1, len(entries) - 1)], seed)]
    if "place" in wanted:
        _place(chosen, tables, tell)
    return doubles


def _state(chosen: Subject, calls: repeats.Calls, entries, tables: Tables, seed: int, tell) -> None:
    """What it keeps between calls: after all other measures, by the same object."""
    if any(r["status"] != "ok" for r in tables.of("runs")) or not tables.of("runs"):
        return
    tell("what it keeps between calls")
    try:
        rows = behaviour.state_between_steps(chosen, entries, seed)
        tables.rows["state"] = [*rows, *repeats.repeated(chosen, calls)]
    except StepFailed as failure:
        tables.failed.setdefault("raised", str(failure))


def _place(chosen: Subject, tables: Tables, tell) -> None:
    """Where it stands beside the trade's integrators, unless it is no step of the system."""
    if judge.gross_failure(judge.judged({}, tables)):
        return
    for scene in scenes(chosen):
        tell(f"its place on {scene}")
        tables.rows.setdefault("place", []).append(place(chosen, scene))


def _times(chosen: Subject, tables: Tables, tell) -> list[dict]:
    """What it takes in time on the scenes on which it has a place."""
    out = []
    for row in tables.of("place"):
        tell(f"its time on {row['on']}")
        out.append(timed_or_failed(chosen, row, placed))
    return [x for x in out if x is not None]


def _first_that_runs(measure: Callable[[str], dict], arithmetics) -> dict:
    """``measure`` in the first arithmetic that the step takes; what it raises in doubles is raised."""
    for arithmetic in arithmetics[:-1]:
        try:
            return measure(arithmetic)
        except StepFailed:
            continue
    return measure(arithmetics[-1])


def _structure(chosen, entry, seed, defect, arithmetics) -> dict:
    try:
        return _first_that_runs(lambda a: structure.measured(Stepper(chosen, entry, a), seed, defect), arithmetics)
    except StepFailed as failure:
        if defect is not structure.symmetry:
            raise
        # A step backwards is not promised.
        return {"on": entry.name, "status": "failed", "reason": f"with -h: {failure}"}


def _adaptive(chosen: Subject, entries, tables: Tables, seed: int, tell) -> None:
    tables.failed["all"] = "an adaptive integrator has no step map of constant h to test"
    for entry in entries:
        tell(f"tolerances on {entry.name}")
        try:
            row = adaptive.tolerances(chosen, entry, seed)
        except adaptive.InputChanged:
            tables.rows.setdefault("input", []).append({"on": entry.name, "value": 1.0, "later": 0.0})
            continue
        tables.rows.setdefault("runs", []).append({"on": entry.name, "status": "ok", "reason": ""})
        tables.rows.setdefault("input", []).append({"on": entry.name, "value": 0.0, "later": 0.0})
        same = {"on": entry.name, "what": "the same run twice", "value": 0.0 if row["repeats"] else 1.0}
        tables.rows.setdefault("state", []).append(same)
        tables.rows.setdefault("tolerance", []).append(row)
