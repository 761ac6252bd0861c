"""Make a run of the benchmarks: choose which measurements ("cells") fit the time budget, make them, write the tables.

Cells are of three classes.  Numbers are measured by every run whose code, data or packages changed them.  Dear numbers
(`LONGEST`) and times are measured on request; times do not become stale when code changes.  Then comes a random sample
of the numbers that did not change, which is only compared with the stored rows.  A finished cell is written to a
journal at once and the tables at the end; the next run continues one that was killed.

Rows are never taken away: a cell that needs a package that is missing keeps its stored rows, and new rows that agree
with the stored ones (`compare.agree`) do not replace them.
"""

from __future__ import annotations

import json
import os
import random
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.files import write_file
from phasebench.reference.installed import is_installed
from phasebench.reference.peers import PEERS
from phasebench.reference.peers.record import NotHere

from . import compare, provenance, tables, workers
from .cells import ALONE, POOL, UNCOMPILED, Cell, Rows
from .cluster import Cluster
from .journal import Entry, Journal, lock

#: Seconds of a run and of the sample, and the share of the budget that is reserved for writing reports.
BUDGET, SAMPLE, REPORTS = 600.0, 30.0, 0.1
#: Assumed seconds of a cell never measured; a cell of more seconds than this is dear, and not in a sample.
UNKNOWN, LONGEST = 5.0, 3.0
#: The file, of this machine alone, with the hashes of cells whose stored rows came out again with other packages.
AGREED = "agreed.json"


@dataclass
class Standing:
    """What is stored of a cell: the hash of what its rows were measured with (None if they were edited), and where."""

    content: str | None = None
    machine: str = ""
    spent: float = UNKNOWN
    measured: bool = False


@dataclass
class Plan:
    """The cells of a run by the reason to measure them; each is in exactly one list.

    Attributes
    ----------
    done : already in the journal of a run that was killed
    changed : new, or stored for other code, data or packages
    dear, times : those of the two classes that are measured on request, and were not asked for
    absent : needing a package that is not installed
    rest : up to date
    """

    done: list[Cell] = field(default_factory=list)
    changed: list[Cell] = field(default_factory=list)
    dear: list[Cell] = field(default_factory=list)
    times: list[Cell] = field(default_factory=list)
    absent: list[Cell] = field(default_factory=list)
    rest: list[Cell] = field(default_factory=list)


@dataclass
class Outcome:
    """The result of a run of the benchmarks.

    Attributes
    ----------
    cells, plan : all cells of the tables; those of this run
    entries, sampled : finished cells by id, those of a killed run included; rows only compared with the stored ones
    agreed : ids of finished cells whose rows agree with the stored ones, which stay
    failed, unavailable : cell id -> why it could not be measured; ids of cells that need what is not here
    left : cells for which there was no time
    seconds : experiment -> seconds spent on its cells
    stored : the tables as they were before the run, by name
    """

    cells: list[Cell]
    plan: Plan
    entries: dict[str, Entry] = field(default_factory=dict)
    agreed: set[str] = field(default_factory=set)
    sampled: dict[str, Rows] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    unavailable: set[str] = field(default_factory=set)
    left: list[Cell] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    stored: dict[str, tables.Table] = field(default_factory=dict)
    seed: int = 0
    notes: list[str] = field(default_factory=list)

    def fresh(self, cell: Cell) -> bool:
        """True if the stored rows of a cell belong to this version of the code."""
        content = standing(cell, self.stored).content
        return content is not None and not cell.outdated(content)

    def failures(self, chosen: Callable[[Cell], bool]) -> list[str]:
        """What failed among the chosen cells, and why."""
        return [f"{c.label}: {self.failed[c.id]}" for c in self.cells if c.id in self.failed and chosen(c)]

    def rows(self, table: str) -> list[dict]:
        """The rows of one table that this run measured anew, those of the random sample included."""
        out = []
        for cell in self.cells:
            rows = self.entries[cell.id].rows if cell.id in self.entries else self.sampled.get(cell.id, {})
            out += rows.get(table, [])
        return out


def entry(cell: Cell, answer: workers.Answer) -> Entry:
    """The journal entry of a finished cell."""
    today = date.today().isoformat()
    seconds = round(answer.seconds, 3)
    return Entry(cell.id, cell.content, today, answer.machine, seconds, answer.value, provenance.commit())


def standing(cell: Cell, stored: dict[str, tables.Table]) -> Standing:
    """Return what is stored of a cell: there is no hash if its rows are missing or were edited."""
    known = stored[cell.tables[0]].keys.get(tables.key_of(cell))
    if known is None:
        return Standing()
    return Standing(tables.version(cell, stored), known["run"].split()[-1], float(known["spent"] or UNKNOWN), True)


def plan(
    cells: Iterable[Cell],
    known: Mapping[str, Standing],
    entries: Mapping[str, Entry],
    agreed: Mapping[str, str] | None = None,
    dear: bool = False,
    times: bool = False,
    again: bool = False,
) -> Plan:
    """Sort the cells by the reason to measure them.

    ``entries`` are the finished cells of a run that was killed, ``agreed`` has the hash for which a cell's stored rows
    came out again on this machine.  With ``dear`` and ``times`` these two classes are measured, too, with ``again`` all
    cells that can be.
    """
    out, machine, agreed = Plan(), provenance.machine(), agreed or {}
    for cell in cells:
        kept, before = entries.get(cell.id), known[cell.id]
        here = provenance.same_hardware
        if kept and kept.content == cell.content and (here(kept.machine, machine) or not cell.own):
            out.done.append(cell)
        elif not cell.available:
            out.absent.append(cell)
        elif again:
            out.changed.append(cell)
        elif cell.own and times:
            current = before.content == cell.content and here(before.machine, machine)
            (out.rest if current else out.changed).append(cell)
        elif before.content is not None and (cell.content in (before.content, agreed.get(cell.id))):
            out.rest.append(cell)
        elif cell.own:
            current = before.content is not None and not cell.outdated(before.content)
            (out.rest if current else out.times).append(cell)
        elif not dear and (cell.dear or (before.measured and before.spent > LONGEST)):
            out.dear.append(cell)
        else:
            out.changed.append(cell)
    return out


def sample(cells: Sequence[Cell], known: dict[str, Standing], seconds: float, seed: int, count: int) -> list[Cell]:
    """Choose cells at random, to measure them again and compare with the stored rows.

    They are taken from each experiment in turn until they need about ``seconds`` together on ``count`` cores.
    """
    rng = random.Random(seed)
    groups: dict[str, list[Cell]] = {}
    for cell in cells:
        if known[cell.id].spent <= LONGEST:
            groups.setdefault(cell.experiment, []).append(cell)
    for members in groups.values():
        rng.shuffle(members)
    out, spent = [], 0.0
    while any(groups.values()):
        for members in groups.values():
            if members:
                cell = members.pop()
                spent += known[cell.id].spent / (1 if cell.where == ALONE else max(1, count))
                if spent > seconds:
                    return out
                out.append(cell)
    return out


def execute(
    cells: Sequence[Cell],
    folder: Path,
    *,
    selected: Callable[[Cell], bool] | None = None,
    budget: float = BUDGET,
    dear: bool = False,
    times: bool = False,
    everything: bool = False,
    quick: bool = False,
    prune: bool = False,
    count: int | None = None,
    seed: int | None = None,
    progress: Callable[[str, int, int, float], None] = lambda *_: None,
    cluster: Cluster | None = None,
) -> Outcome:
    """Measure cells within a time budget, and write the tables.

    Parameters
    ----------
    cells, folder : cells of the tables, and the folder of these; stored rows of other cells stay
    selected : predicate; only these cells are measured, even if unchanged
    dear, times : measure these two classes of cells, too; times without a time limit
    everything : measure every cell, without a time limit
    quick : no random sample is taken; the tables are marked as quick
    prune : delete stored rows that belong to none of the cells
    count : number of parallel processes; 0 measures in this one
    seed : of the sample; by default the ordinal of today's date
    progress : called with an experiment, the cells done and in all, and the estimated seconds left
    cluster : measures the cells that are not timed

    Raises InvalidInput if another run writes to the folder, or it is quick and the folder has tables of a full run.
    """
    if len({c.id for c in cells}) != len(cells):
        raise ValueError("two cells have the same key")
    began = time.monotonic()
    deadline = float("inf") if everything or times else began + budget * (1 - REPORTS)
    count = (os.cpu_count() or 1) if count is None else count
    seed = date.today().toordinal() if seed is None else seed
    with lock(folder):
        journal = Journal(folder / "journal.jsonl")
        stored = {t: tables.Table(folder, t) for t in dict.fromkeys(t for c in cells for t in c.tables)}
        if quick and any(t.rows and t.about.get("quick") is False for t in stored.values()):
            raise InvalidInput(f"{folder} has tables of a full run, which a quick one would replace: write elsewhere")
        known, agreed = {c.id: standing(c, stored) for c in cells}, _agreed(folder)
        wanted = [c for c in cells if selected is None or selected(c)]
        again = everything or selected is not None
        todo = plan(wanted, known, journal.entries, agreed, dear or quick, times or quick, again)
        out = Outcome(list(cells), todo, stored=stored, seed=seed)
        if journal.unreadable:
            out.notes.append(f"{journal.unreadable} unreadable lines of {journal.path} count as not measured")
        out.entries = {c.id: journal.entries[c.id] for c in todo.done}
        if todo.done:
            out.notes.append(f"{len(todo.done)} cells were measured by a run that did not end")
        work = _Work(out, journal, known, count, progress, cluster)
        work.measure([*todo.changed], deadline)
        spare = min(deadline, time.monotonic() + SAMPLE)
        if selected is None and not everything and not quick and spare > time.monotonic():
            picked = sample(todo.rest, known, spare - time.monotonic(), seed, count)
            work.measure(picked, spare, compared=True)
        known_end = out.entries.keys() | out.failed.keys() | out.unavailable
        out.left = [c for c in todo.changed if c.id not in known_end]
        own = {c.id: c for c in cells}
        out.agreed = {id for id, e in out.entries.items() if not own[id].own and compare.agree(own[id], e, stored)}
        done = tables.write(folder, cells, out.entries, stored, out.agreed, quick, prune)
        again_here = {id: own[id].content for id in out.agreed if not own[id].outdated(known[id].content)}
        if again_here:
            write_file(folder / AGREED, json.dumps(agreed | again_here, indent=0, sort_keys=True) + "\n")
        out.notes += _notes(out, budget, done.orphans)
        journal.drop(out.entries)
    return out


def _agreed(folder: Path) -> dict[str, str]:
    try:
        return json.loads((folder / AGREED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _notes(out: Outcome, budget: float, orphans: Mapping[str, int]) -> list[str]:
    found = []
    if out.left:
        found.append(
            f"{len(out.left)} cells are not measured by this version of the code on this machine: the budget of "
            f"{budget:g} s is spent; run again, or with --all"
        )
    for option, cells in (("--dear", out.plan.dear), ("--times", out.plan.times)):
        if cells:
            found.append(f"{len(cells)} cells are new or of an earlier version, and measured on request: {option}")
    if out.plan.absent:
        packages = sorted({p.package for p in PEERS if not is_installed(p.package)})
        names = f" ({', '.join(packages)})" if packages else ""
        found.append(f"{len(out.plan.absent)} cells need packages that are not installed{names}: their rows stay")
    if orphans:
        rows = f"{sum(orphans.values())} rows of {', '.join(orphans)}"
        found.append(f"{rows} belong to no measurement of this version and stay; --update-tables removes them")
    return found


@dataclass
class _Work:
    """Measures the cells of a run, kind after kind: on all cores, timed ones, those without Numba."""

    out: Outcome
    journal: Journal
    known: dict[str, Standing]
    count: int
    progress: Callable[[str, int, int, float], None]
    cluster: Cluster | None

    def measure(self, cells: list[Cell], deadline: float, compared: bool = False) -> None:
        left = sum(self._share(c) for c in cells)
        done, total = 0, len(cells)
        lanes = {w: lane for w in (POOL, ALONE, UNCOMPILED) if (lane := [c for c in cells if c.where == w])}
        if not compared:
            lanes = self._checked_beside(lanes)
        for k, (where, lane) in enumerate(lanes.items()):
            count = min(self.count, 1) if where == ALONE else self.count
            now = time.monotonic()
            if now >= deadline:
                return
            # A sample has cells of every kind: each kind gets an equal share of the time that is left.
            until = now + (deadline - now) / (len(lanes) - k) if compared else deadline
            cluster = None if where == ALONE else self.cluster
            for cell, answer in workers.measure(lane, where, until, count, cluster):
                left -= self._share(cell)
                if self._is_disturbed(cell, where, answer):
                    lanes[ALONE].append(cell)
                    continue
                done += 1
                self.progress(cell.experiment, done, total, max(0.0, min(left, deadline - time.monotonic())))
                self._keep(cell, answer, compared)

    def _checked_beside(self, lanes: dict[str, list[Cell]]) -> dict[str, list[Cell]]:
        """Move cells that are timed, but whose stored rows may come out again, to those that run beside each other.

        Their times are not stored where their other numbers agree; where they do not, they are measured once more.
        """
        alone = lanes.get(ALONE, [])
        beside = [c for c in alone if not c.own and self.known[c.id].content is not None] if self.count > 1 else []
        if not beside:
            return lanes
        rest = {ALONE: [c for c in alone if c not in beside], UNCOMPILED: lanes.get(UNCOMPILED, [])}
        return {POOL: [*lanes.get(POOL, []), *beside], **rest}

    def _is_disturbed(self, cell: Cell, where: str, answer: workers.Answer) -> bool:
        """True for an answer of a timed cell that ran beside others and has to be measured alone."""
        if cell.where != ALONE or where == ALONE:
            return False
        if answer.error is not None:
            return "Unavailable: " not in answer.error
        return not compare.agree(cell, entry(cell, answer), self.out.stored)

    def _share(self, cell: Cell) -> float:
        return self.known[cell.id].spent / (1 if cell.where == ALONE else max(1, self.count))

    def _keep(self, cell: Cell, answer: workers.Answer, compared: bool) -> None:
        out = self.out
        out.seconds[cell.experiment] = out.seconds.get(cell.experiment, 0.0) + answer.seconds
        error = answer.error or _lack_here(answer.value) or _flaw(cell, answer.value)
        if error is not None and "Unavailable: " in error:
            out.unavailable.add(cell.id)
            out.notes.append(f"{cell.label}: {error.partition('Unavailable: ')[2]}")
        elif error is not None:
            out.failed[cell.id] = error
        elif compared:
            out.sampled[cell.id] = answer.value
        else:
            out.entries[cell.id] = entry(cell, answer)
            self.journal.put(out.entries[cell.id])


def _lack_here(rows: Rows) -> str | None:
    """Why this machine cannot make a measurement, if one of its rows says so: such rows replace no others."""
    found = (v for members in rows.values() for row in members for v in row.values() if isinstance(v, NotHere))
    return next((f"Unavailable: {why}" for why in found), None)


def _flaw(cell: Cell, rows: Rows) -> str | None:
    if set(rows) != set(cell.tables):
        return f"it measured tables {sorted(rows)}, not {sorted(cell.tables)}"
    for members in rows.values():
        for row in members:
            wrong = [k for k, v in cell.key.items() if tables.text(row.get(k)) != tables.text(v)]
            if wrong:
                return f"a row's {', '.join(wrong)} is not the cell's"
            if taken := {*row} & {*tables.PROVENANCE}:
                return f"a row's column {', '.join(taken)} is the provenance's"
    if not any(rows.values()):
        return "it has no rows"
    return None
