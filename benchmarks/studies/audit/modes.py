"""Test whether an integrator leaves the process's floating-point mode as it found it.

In a fresh process small numbers are not flushed to zero: 2^-1074 survives an addition.  The package is loaded and the
integrator runs a few steps, without the restoring of the mode that `integrate_peer` does; then the addition is
repeated.  All integrators of a package share one process until one of them changes the mode; the next gets a new one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phasebench.benchmarks.audit import cases
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.store.workers import Worker
from phasebench.reference.installed import version_of
from phasebench.reference.peers import PEERS, Peer, Task, floating

#: Steps of a run; the problem that is preferred, as packages have forces of their own for it and compile little.
STEPS = 10
FIRST = "kepler"
#: Time limit in seconds of one integrator, including the import of its package.
SECONDS = 70.0
KEPT, BY_LOADING, BY_RUN = "kept", "changed as the package is loaded", "changed by a run"
#: Package -> ids of its integrators; this project's are the controls.
IDS = {p.package: [x.id for x in PEERS if x.package == p.package] for p in PEERS} | {"phasebench": [*cases.CONTROLS]}


def row(chosen: Integrator) -> dict:
    """The floating-point mode that an integrator leaves in this process; "invalid" if it was wrong before."""
    out = _head(chosen)
    if not floating.gradual():
        return out | {"problem": "", "status": "invalid", "reason": "the process flushed small numbers before"}
    preferred = sorted(cases.CASES, key=lambda c: c.problem != FIRST)
    case = next((c for c in preferred if cases.able(chosen, (c,))), None)
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


def _head(chosen: Integrator) -> dict:
    return {"package": chosen.kind, "version": version_of(chosen.kind) or "absent", "peer": chosen.id, "mode": None}


def _bare(chosen: Integrator, case: cases.Case) -> None:
    """Take a few steps of a case; a peer is called through its package alone, without this project's wrapper."""
    made = cases.problem(case)
    if not isinstance(chosen.record, Peer):
        chosen.run(made, h=case.h, steps=STEPS)
        return
    numbers = list(range(STEPS + 1))
    q, p = (np.array(x, dtype=float) for x in (made.q0, made.p0))
    times = case.h * np.array(numbers)
    chosen.record.run(Task(made, made.system, q, p, case.h, numbers, times, chosen.record.tol))


def judge(id: str) -> tuple[dict, bool]:
    """(An integrator's row, whether small numbers still add correctly in this process)."""
    return row(integrator(id)), floating.gradual()


def judge_all(ids: Sequence[str]) -> list[dict]:
    """The rows of integrators, each in a process whose floating-point mode was right at first."""
    rows: list[dict] = []
    with Worker() as worker:
        for id in ids:
            fresh = worker.process is None
            answer = worker.call(judge, id, seconds=SECONDS)
            if answer.error is not None and not fresh:  # one before it may be why
                answer = worker.call(judge, id, seconds=SECONDS)
            if answer.error is None:
                found, good = answer.value
            else:
                found, good = _head(integrator(id)) | {"problem": "", "status": "invalid", "reason": answer.error}, True
            rows.append(found)
            if not good:
                worker.stop()
    return rows


def measure(package: str) -> list[dict]:
    """The rows of a package's integrators."""
    return judge_all(IDS[package])
