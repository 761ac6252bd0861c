"""Make a run of the benchmarks: choose which measurements ("cells") fit the time budget, make them, write the tables.

New and changed cells come first, then timings from another machine, then a random sample of the rest, which is only
compared with the stored rows.  A finished cell is written to a journal at once and the tables at the end; the next run
continues one that was killed.
"""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

from phasebench.integrators.errors import InvalidInput

from . import provenance, tables, workers
from .cells import ALONE, POOL, UNCOMPILED, Cell, Rows
from .cluster import Cluster
from .journal import Entry, Journal, lock

#: Seconds of a run and of the sample, and the share of the budget that is reserved for writing reports.
BUDGET, SAMPLE, REPORTS = 600.0, 30.0, 0.1
#: Assumed seconds of a cell never measured, and largest seconds of a cell in the sample.
UNKNOWN, LONGEST = 5.0, 3.0


@dataclass
class Standing:
    """What is stored of a cell (one measurement).

    Attributes
    ----------
    content : hash of the code and data that its rows were measured with; None if rows are missing or were edited
    machine, spent : the machine, and the seconds that the measurement took
    """

    content: str | None = None
    machine: str = ""
    spent: float = UNKNOWN


@dataclass
class Plan:
    """The cells (single measurements) of a run, sorted by the reason to measure them; each is in exactly one list.

    Attributes
    ----------
    done : already in the journal of a run that was killed
    changed : new, or stored for other code or data
    own : dependent on the machine, and stored from another one
    rest : up to date
    """

    done: list[Cell] = field(default_factory=list)
    changed: list[Cell] = field(default_factory=list)
    own: list[Cell] = field(default_factory=list)
    rest: list[Cell] = field(default_factory=list)


@dataclass
class Outcome:
    """The result of a run of the benchmarks, whose unit is the cell (one measurement).

    Attributes
    ----------
    cells, plan : all cells of the tables; those of this run, sorted by the reason to measure them (`Plan`)
    entries : finished cells by id, including those of a run that was killed before
    sampled : rows by cell id, measured only to compare them with the stored ones
    failed : cell id -> why it could not be measured
    unavailable : ids of cells that need what is not here, such as a package
    left : cells for which there was no time
    seconds : experiment -> seconds spent on its cells
    stored : the tables as they were before the run, by name
    seed, notes : the seed of the random sample; remarks for the user
    """

    cells: list[Cell]
    plan: Plan
    entries: dict[str, Entry] = field(default_factory=dict)
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
        return standing(cell, self.stored).content == cell.content

    def rows(self, table: str) -> list[dict]:
        """The rows of one table that this run measured anew, those of the random sample included."""
        out = []
        for cell in self.cells:
            rows = self.entries[cell.id].rows if cell.id in self.entries else self.sampled.get(cell.id, {})
            out += rows.get(table, [])
        return out


def entry(cell: Cell, answer: workers.Answer) -> Entry:
    """The journal entry of a finished cell, from the answer of the process that measured it."""
    today = date.today().isoformat()
    return Entry(cell.id, cell.content, today, answer.machine, round(answer.seconds, 3), answer.value)


def standing(cell: Cell, stored: dict[str, tables.Table]) -> Standing:
    """Return the hash of all that the stored rows of a cell depend on, the machine, and the seconds they took.

    There is no hash if the rows are missing or were edited.
    """
    found = tables.version(cell, stored)
    if found is None:
        return Standing()
    row = next(row for t in cell.tables for row in stored[t].of(cell))
    return Standing(found, row.get("machine", ""), float(row.get("spent") or UNKNOWN))


def plan(
    cells: Iterable[Cell],
    known: dict[str, Standing],
    entries: dict[str, Entry],
    machine: str,
    again: bool = False,
) -> Plan:
    """Sort the cells (single measurements) by the reason to measure them.

    ``known`` has what is stored of each cell, ``entries`` the finished cells of a run that was killed, ``machine`` is
    the name of this machine.  With ``again`` unchanged cells count as changed.
    """
    out, alike = Plan(), provenance.same_hardware
    for cell in cells:
        kept, before = entries.get(cell.id), known[cell.id]
        if kept and kept.content == cell.content and (alike(kept.machine, machine) or not cell.own):
            out.done.append(cell)
        elif before.content != cell.content or again:
            out.changed.append(cell)
        elif cell.own and not alike(before.machine, machine):
            out.own.append(cell)
        else:
            out.rest.append(cell)
    return out


def sample(cells: Sequence[Cell], known: dict[str, Standing], seconds: float, seed: int, count: int) -> list[Cell]:
    """Choose some of the cells (single measurements) at random, to measure them again and compare with the stored rows.

    They are taken from each experiment in turn until they need about ``seconds`` together on ``count`` cores; ``known``
    has the time that each takes, ``seed`` is that of the random numbers.
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
    everything: bool = False,
    quick: bool = False,
    count: int | None = None,
    seed: int | None = None,
    progress: Callable[[str, int, int, float], None] = lambda *_: None,
    cluster: Cluster | None = None,
) -> Outcome:
    """Measure cells (single measurements) within a time budget, and write the tables.

    Parameters
    ----------
    cells : all cells of their tables; stored rows of other cells are deleted
    folder : the folder of the tables
    selected : predicate; only these cells are measured, even if unchanged
    budget : seconds
    everything : measure every cell, without a time limit
    quick : no random sample is taken; the tables are marked as quick
    count : number of parallel processes; 0 measures in this one
    seed : of the sample; by default the ordinal of today's date
    progress : called with an experiment, the cells done and in all, and the estimated seconds left
    cluster : measures the cells that are not timed

    Raises
    ------
    InvalidInput
        If another run writes to the folder, or it is quick and the folder has tables of a full run.
    ValueError
        If two cells have the same id.
    """
    if len({c.id for c in cells}) != len(cells):
        raise ValueError("two cells have the same key")
    began = time.monotonic()
    deadline = float("inf") if everything else began + budget * (1 - REPORTS)
    count = (os.cpu_count() or 1) if count is None else count
    seed = date.today().toordinal() if seed is None else seed
    with lock(folder):
        journal = Journal(folder / "journal.jsonl")
        stored = {t: tables.Table(folder, t) for t in dict.fromkeys(t for c in cells for t in c.tables)}
        if quick and any(t.rows and t.about.get("quick") is False for t in stored.values()):
            raise InvalidInput(f"{folder} has tables of a full run, which a quick one would replace: write elsewhere")
        known = {c.id: standing(c, stored) for c in cells}
        wanted = [c for c in cells if selected is None or selected(c)]
        todo = plan(wanted, known, journal.entries, provenance.machine(), again=everything or selected is not None)
        out = Outcome(list(cells), todo, stored=stored, seed=seed)
        if journal.unreadable:
            out.notes.append(f"{journal.unreadable} unreadable lines of {journal.path} count as not measured")
        out.entries = {c.id: journal.entries[c.id] for c in todo.done}
        if todo.done:
            out.notes.append(f"{len(todo.done)} cells were measured by a run that did not end")
        work = _Work(out, journal, known, count, progress, cluster)
        work.measure([*todo.changed], deadline)
        work.measure([*todo.own], deadline)
        spare = min(deadline, time.monotonic() + SAMPLE)
        if selected is None and not everything and not quick and spare > time.monotonic():
            picked = sample(todo.rest, known, spare - time.monotonic(), seed, count)
            work.measure(picked, spare, compared=True)
        known_end = out.entries.keys() | out.failed.keys() | out.unavailable
        out.left = [c for c in (*todo.changed, *todo.own) if c.id not in known_end]
        if out.left:
            out.notes.append(
                f"{len(out.left)} cells are not measured by this version of the code on this machine: the budget of "
                f"{budget:g} s is spent; run again, or with --all"
            )
        tables.write(folder, cells, out.entries, quick)
        journal.drop(out.entries)
    return out


class _Work:
    """Measures the cells (single measurements) of a run, kind after kind.

    First come those that run beside each other on all cores, then the timed ones, then those without Numba.  Results go
    into ``out`` and, as they are finished, into the journal, a file from which a killed run is continued.
    """

    def __init__(
        self,
        out: Outcome,
        journal: Journal,
        known: dict[str, Standing],
        count: int,
        progress: Callable[[str, int, int, float], None],
        cluster: Cluster | None,
    ) -> None:
        self.out, self.journal, self.known, self.count, self.progress = out, journal, known, count, progress
        self.cluster = cluster

    def measure(self, cells: list[Cell], deadline: float, compared: bool = False) -> None:
        """Measure cells (single measurements) until the deadline, a time of `time.monotonic`.

        If they are only to be ``compared`` with stored rows (a sample), their rows are not stored.
        """
        left = sum(self._share(c) for c in cells)
        done = 0
        lanes = {w: lane for w in (POOL, ALONE, UNCOMPILED) if (lane := [c for c in cells if c.where == w])}
        for k, (where, lane) in enumerate(lanes.items()):
            count = min(self.count, 1) if where == ALONE else self.count
            now = time.monotonic()
            if now >= deadline:
                return
            # A sample has cells of every kind: each kind gets an equal share of the time that is left.
            until = now + (deadline - now) / (len(lanes) - k) if compared else deadline
            cluster = None if where == ALONE else self.cluster
            for cell, answer in workers.measure(lane, where, until, count, cluster):
                done, left = done + 1, left - self._share(cell)
                self.progress(cell.experiment, done, len(cells), max(0.0, min(left, deadline - time.monotonic())))
                self._keep(cell, answer, compared)

    def _share(self, cell: Cell) -> float:
        return self.known[cell.id].spent / (1 if cell.where == ALONE else max(1, self.count))

    def _keep(self, cell: Cell, answer: workers.Answer, compared: bool) -> None:
        out = self.out
        out.seconds[cell.experiment] = out.seconds.get(cell.experiment, 0.0) + answer.seconds
        error = _flaw(cell, answer.value) if answer.error is None else answer.error
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


def _flaw(cell: Cell, rows: Rows) -> str | None:
    """Why the measured rows (table -> rows) are not valid for the cell, such as a wrong key; None if they are valid."""
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
