"""Measure all properties of an integrator for its certificate, in turn; last, whether it remembers earlier calls."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

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


@dataclass
class Run:
    """A certification in progress: what is certified, in which file (``where``), and what was measured so far.

    If ``alone``, only what is claimed is measured; ``doubles`` says why it was measured in doubles only.
    """

    id: str
    claims: Mapping[str, Any]
    requires: tuple[str, ...]
    seed: int
    alone: bool
    tables: Tables
    where: str = ""
    doubles: str = ""
    seconds: float = 0.0


def fill_tables(chosen: Subject, run: Run, own: list[Entry], tell: Callable[[str], None]) -> list[dict]:
    """Measure an integrator and fill the tables of its certification; return the rows of its times (`times.times_row`).

    ``own`` are the user's own problems, measured in place of the battery; ``tell`` is called with the name of each
    measure.
    """
    if chosen.integrator is not None and not getattr(chosen.integrator.record, "one_step", True):
        why = "it is a multistep method: it needs earlier states, which a step (system, q, p, h) does not have"
        run.tables.failed |= {"runs": why, "all": why}
        return []
    return _Measures(chosen, run, own, tell).fill()


class _Measures:
    """The measures of one integrator, whose step is ``heard`` where its calls are recorded, in order to repeat them."""

    def __init__(self, chosen: Subject, run: Run, own: list[Entry], tell: Callable[[str], None]) -> None:
        self.chosen, self.run, self.own, self.tell = chosen, run, own, tell
        self.tables, self.seed = run.tables, run.seed
        self.heard, self.calls = repeats.listening(chosen, run.seed)
        self.special = next((of for trait, of in battery.BY_TRAIT.items() if trait in chosen.own.requires), None)
        self.wanted = self._wanted()
        self.entries = self._able(own or (self.special or battery.entries)())

    def _wanted(self) -> set[str]:
        claims, wanted = self.chosen.own.claims, set(EVERYTHING)
        if self.run.alone:
            wanted = {x for check in (CHECKS[name] for name in claims) for x in (check.measure, *check.needs)}
        wanted -= ELSEWHERE if self.own else set()
        return wanted if MAGNETIC in self.chosen.own.requires or "volume" in claims else wanted - {"volume"}

    def _able(self, entries: Iterable[Entry]) -> list[Entry]:
        entries = list(entries)
        able = [e for e in entries if self.chosen.lacks(e.system) is None]
        if not able:
            why = next(filter(None, (self.chosen.lacks(e.system) for e in entries)), "there is no system")
            self.tables.failed["runs"] = f"none of the systems is of the kind that it requires: {why}"
        return able

    def _add(self, table: str, row: dict) -> None:
        self.tables.rows.setdefault(table, []).append(row)

    def fill(self) -> list[dict]:
        """Make all measures; return the rows of times."""
        chosen, times = self.chosen, []
        if any(entry.system.constrained for entry in self.entries):
            self.wanted.discard("volume")
            self.tables.failed["volume"] = "on a manifold, volume is not measured"
        self.run.doubles = "an adaptive integrator has no step" if chosen.adaptive else ""
        try:
            if chosen.adaptive:
                self._adaptive()
                if not self.run.alone and not self.own:
                    self._place(chosen)
            else:
                several = [e for e in self.special() if e.lasting] if self.special else battery.lasting()
                lasting = self._able(self.own or several) if "long" in self.wanted else []
                self.run.doubles = self._step(lasting) if self.entries else ""
            times = self._times()
        except StepFailed as failure:
            self.tables.failed["raised"] = str(failure)
        if not chosen.adaptive:
            self._state()
            if chosen.integrator is None and self.special is None and not self.own:
                self._sweep()
        return times

    def _step(self, lasting: list[Entry]) -> str:
        """Measure a step, its long runs on ``lasting``; return why it was in doubles only, or ""."""
        chosen, entries, tables, seed, tell = self.heard, self.entries, self.tables, self.seed, self.tell
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
        chosen = self._rounding(chosen)
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
            self._add("order", row | {"separable": entry.system.separable})
        tables.done |= {"order", "consistent"}
        self._exchange(chosen, arithmetics[0])
        self._structures(chosen, arithmetics)
        if "stability" in self.wanted and chosen.lacks(battery.oscillator().system) is None:
            tell("stability")
            tables.rows["stability"] = [behaviour.stability(chosen)]
            tables.done.add("stability")
        for entry in lasting:
            tell(f"a long run on {entry.name}")
            self._add("long", conservation.long_run(chosen, entry, seed))
        tables.done.add("long")
        if "round_off" in self.wanted and not doubles:
            rounded = conservation.round_off(chosen, entries[min(1, len(entries) - 1)], seed)
            tables.rows["round_off"] = [rounded] if rounded else []
        if "place" in self.wanted:
            self._place(chosen)
        return doubles

    def _rounding(self, chosen: Subject) -> Subject:
        """The integrator with its measured rounding, if that is of single precision."""
        coarse = max((r["value"] for r in self.tables.of("rounding")), default=0.0)
        return replace(chosen, eps=coarse) if PRECISIONS["double"] < coarse <= PRECISIONS["single"] else chosen

    def _exchange(self, chosen: Subject, arithmetic: str) -> None:
        """Where a splitting is not of its claimed order, measure it with drifts and kicks exchanged, as a hint."""
        claimed, tables = chosen.own.claims.get("order"), self.tables
        if claimed is None or chosen.own.exchanged is None or tables.failed:
            return
        if judge.judgement(CHECKS["order"], claimed, tables).verdict != CONTRADICTED:
            return
        says, step = chosen.own.exchanged
        other = replace(chosen, own=replace(chosen.own, step=step))
        rows = [order(Stepper(other, e, arithmetic), self.seed) for e in self.entries[:2]]
        if all(agrees(r, claimed) for r in rows):
            for row in tables.rows["order"]:
                row["hint"] = f"; with {says} it is"

    def _structures(self, chosen: Subject, arithmetics: Sequence[str]) -> None:
        for name in (name for name in DEFECTS if name in self.wanted):
            self.tell(name)
            for entry in self.entries:
                if entry.reversible or name != "reversible":
                    row = self._structure(chosen, entry, DEFECTS[name], arithmetics)
                    self._add(name, row | {"separable": entry.system.separable})
            if name == "symplectic" and chosen.own.claims.get(name):
                self._finer(chosen)
            self.tables.done.add(name)
        if "symplectic" in self.wanted:
            self.tell("jumps of the map")
            floors = {r["on"]: r["floor"] for r in self.tables.of("symplectic") if r.get("arithmetic") == DOUBLE}
            unheard = repeats.unheard(chosen)
            found = [jumps(unheard, entry, self.seed, floors.get(entry.name, 0.0)) for entry in self.entries]
            self.tables.rows["jumps"] = found
            self.tables.done.add("jumps")

    def _structure(self, chosen: Subject, entry: Entry, defect: Callable, arithmetics: Sequence[str]) -> dict:
        def row(arithmetic: str) -> dict:
            return structure.structure_row(Stepper(chosen, entry, arithmetic), self.seed, defect)

        try:
            return _first_that_runs(row, arithmetics)
        except StepFailed as failure:
            if defect is not structure.symmetry:
                raise
            # A step need not accept a negative h.
            return {"on": entry.name, "status": "failed", "reason": f"with -h: {failure}"}

    def _finer(self, chosen: Subject) -> None:
        """Measure the largest broken defect at a quarter of its h, too, which tells why it is broken."""
        bad = [r for r in self.tables.of("symplectic") if shows_structure(r) is False]
        if not bad:
            return
        worst = max(bad, key=lambda r: r["value"])
        entry = next(e for e in self.entries if e.name == worst["on"])
        with contextlib.suppress(StepFailed), precision(DIGITS):
            stepper = Stepper(chosen, entry, worst["arithmetic"])
            worst["finer"] = structure.row_at(stepper, self.seed, worst["h"] / entry.unit / 4, structure.symplecticity)

    def _place(self, chosen: Subject) -> None:
        """Compare its gradient evaluations with the fewest stored, unless it does not run or is not consistent."""
        if judge.gross_failure(judge.judgements({}, self.tables)):
            return
        for scene in scenes(chosen):
            self.tell(f"its place on {scene}")
            self._add("place", place(chosen, scene))

    def _times(self) -> list[dict]:
        out = []
        for row in self.tables.of("place"):
            self.tell(f"its time on {row['on']}")
            out.append(timed_or_failed(self.chosen, row, placed))
        return [x for x in out if x is not None]

    def _adaptive(self) -> None:
        self.tables.failed["all"] = "an adaptive integrator has no step map of constant h to test"
        for entry in self.entries:
            self.tell(f"tolerances on {entry.name}")
            try:
                row = adaptive.tolerances(self.chosen, entry, self.seed)
            except adaptive.InputChanged:
                self._add("input", {"on": entry.name, "value": 1.0, "later": 0.0})
                continue
            except adaptive.Unknown as unknown:
                self.tables.failed["tolerance"] = str(unknown)
                continue
            self._add("runs", {"on": entry.name, "status": "ok", "reason": ""})
            self._add("input", {"on": entry.name, "value": 0.0, "later": 0.0})
            value = 0.0 if row["repeats"] else 1.0
            self._add("state", {"on": entry.name, "what": "the same run twice", "value": value})
            self._add("tolerance", row)

    def _state(self) -> None:
        """Measure whether a step remembers earlier calls: after all other measures, whose calls are repeated."""
        if any(r["status"] != "ok" for r in self.tables.of("runs")) or not self.tables.of("runs"):
            return
        self.tell("what it keeps between calls")
        try:
            rows = behaviour.state_between_steps(self.heard, self.entries, self.seed)
            self.tables.rows["state"] = [*rows, *repeats.repeat_calls(self.heard, self.calls)]
        except StepFailed as failure:
            self.tables.failed.setdefault("raised", str(failure))

    def _sweep(self) -> None:
        """Compare a step that keeps nothing between calls with itself in other units."""
        tables = self.tables
        if tables.failed.keys() & {"raised", "all"} or stateless(tables).verdict != HOLDS:
            return
        self.tell("the same in other units")
        kept = [n for n in DEFECTS if tables.of(n)]
        found, broken, reach = sweep(self._rounding(self.chosen), self.entries, self.seed, kept)
        tables.rows["states"] += found
        for name, row in broken.items():
            tables.rows[name].append(row)
        tables.rows |= {"reach": [reach | {"calls": self.calls.count}]} if reach else {}


def _first_that_runs(measure: Callable[[str], Any], arithmetics: Sequence[str]) -> Any:
    """``measure(arithmetic)`` for the first of the arithmetics that the step accepts."""
    for arithmetic in arithmetics[:-1]:
        with contextlib.suppress(StepFailed):
            return measure(arithmetic)
    return measure(arithmetics[-1])
