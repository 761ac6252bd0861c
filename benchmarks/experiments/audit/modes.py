"""Whether an integrator leaves the process's floating-point mode as it found it.

In a fresh process that computes as IEEE 754 has it, 2^-1074 survives an addition.  The package is loaded, the
integrator runs a few steps, without what `integrate_peer` takes back, and the addition is made again.  The integrators
of a package follow one another in one process as long as none of them changes the mode; after one that does comes a new
process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence

import numpy as np

from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.rows.cells import Cell, Rows, content
from phasebench.reference.peers import PEERS, Peer, Task, floating
from phasebench.reference.tables import version_of

from . import cases

TABLE = "audit_modes"
#: Steps of a run; a problem that the packages put to their own forces comes first, to compile little.
STEPS = 10
FIRST = "kepler"
#: Seconds for a package's process, and for each of its integrators.
LOADING, EACH = 60.0, 10.0
KEPT, BY_LOADING, BY_RUN = "kept", "changed as the package is loaded", "changed by a run"

CODE = "from phasebench.benchmarks.experiments.audit.modes import serve; serve()"


def row(chosen: Integrator) -> dict:
    """What an integrator leaves, in this process: status "invalid" where the mode was another one before."""
    out = {"package": chosen.kind, "version": version_of(chosen.kind) or "absent", "peer": chosen.id, "mode": None}
    if not floating.gradual():
        return out | {"problem": "", "status": "invalid", "reason": "the process flushed small numbers before"}
    case = next(cases.able(chosen, sorted(cases.CASES, key=lambda c: c.problem != FIRST)), None)
    if case is None:
        return out | {"problem": "", "status": "skipped", "reason": "it can do none of the problems of the audit"}
    out |= {"problem": case.problem, "status": "ok", "reason": ""}
    try:
        chosen.load()
        if not floating.gradual():
            return out | {"mode": BY_LOADING}
        _bare(chosen, case)
    except ImportError as error:
        return out | {"status": "skipped", "reason": f"{chosen.kind} cannot be imported ({error})"}
    except Exception as error:
        out |= {"status": "invalid", "reason": f"{type(error).__name__}: {error}"}
    if not floating.gradual():
        return out | {"status": "ok", "mode": BY_RUN}
    return out | ({"mode": KEPT} if out["status"] == "ok" else {})


def _bare(chosen: Integrator, case: cases.Case) -> None:
    """A run of a few steps; of a peer what its package does and nothing besides."""
    made = cases.problem(case)
    if not isinstance(chosen.record, Peer):
        chosen.run(made, h=case.h, steps=STEPS)
        return
    numbers = list(range(STEPS + 1))
    q, p = (np.array(x, dtype=float) for x in (made.q0, made.p0))
    times = case.h * np.array(numbers)
    chosen.record.run(Task(made, made.system, q, p, case.h, numbers, times, chosen.record.tol))


def serve() -> None:
    """Print the row of each integrator of the command line, a line each, up to the first that changes the mode."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what packages print
    for id in sys.argv[1:]:
        answers.write(json.dumps(row(integrator(id))) + "\n")
        answers.flush()
        if not floating.gradual():
            return


def _printed(ids: Sequence[str]) -> tuple[list[dict], str]:
    """(the rows that a fresh process prints for some integrators, why there are no more)."""
    command = [sys.executable, "-c", CODE, *ids]
    seconds = LOADING + EACH * len(ids)
    try:
        done = subprocess.run(command, capture_output=True, timeout=seconds, check=False)
        text, why = done.stdout, f"its process ended with code {done.returncode}"
    except subprocess.TimeoutExpired as stopped:
        text, why = stopped.stdout or b"", f"it did not return within {seconds:g} s"
    return [json.loads(line) for line in text.decode().splitlines() if line.endswith("}")], why


def measured(ids: tuple[str, ...]) -> Rows:
    """The rows of some integrators; each one is judged in a process whose mode was as it should be before it."""
    rows: list[dict] = []
    while left := ids[len(rows) :]:
        more, why = _printed(left)
        if not more:
            lost = integrator(left[0])
            about = {"package": lost.kind, "version": version_of(lost.kind) or "absent", "peer": lost.id, "mode": None}
            more = [about | {"problem": "", "status": "invalid", "reason": why}]
        rows += more
    return {TABLE: rows}


def cells(controls: Sequence[str]) -> list[Cell]:
    """A cell for each package, and one for the controls."""
    packages: dict[str, list] = {}
    for p in PEERS:
        packages.setdefault(p.package, []).append(p)
    of_peers = [_cell(package, members) for package, members in packages.items()]
    return [*of_peers, _cell("phasebench", [integrator(id).record for id in controls])]


def _cell(package: str, members: list) -> Cell:
    ids = tuple(m.id for m in members)
    return Cell(
        "audit",
        (TABLE,),
        {"package": package},
        measured,
        (ids,),
        content(TABLE, version_of(package) or "absent", *members, code=[__name__]),
        frozenset({package, *ids}),
    )
