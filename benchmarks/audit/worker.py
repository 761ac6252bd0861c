"""Run measures within a time budget, in a separate process that is killed where a package does not return.

A measure checks the clock between its runs and ends early with what it has.  If a single run does not return, the
process is killed, the row says so, and a new process takes over.
"""

from __future__ import annotations

import atexit
import contextlib
import time
from functools import cache
from math import isfinite

from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.store.workers import LATE, Worker
from phasebench.integrators.record import Method
from phasebench.reference.installed import version_of
from phasebench.reference.peers import Peer

from . import cases, measures

#: Time limit in seconds for loading a package and compiling a peer for its cases.
LOADING = 120.0
#: The process is killed after `PATIENCE` times the budget of a measure plus `MORE` seconds.
PATIENCE, MORE = 1.5, 3.0
#: The measure that loads the package and takes one step on each case.
PREPARE = "package"


def row(
    peer: str | Method | Peer | Integrator, measure: str, case_name: str = "", seconds: float = float("inf")
) -> dict:
    """The row of one ``measure`` of a peer on a case; after ``seconds``, reference states apart, no run begins."""
    peer = integrator(peer)
    if measure in cases.AGAINST_TRUTH:
        cases.truth(cases.BY_NAME[case_name])
    began = time.monotonic()
    out = blank(peer, measure, case_name)

    stopped = False

    def late(more: float = 0.0) -> bool:
        nonlocal stopped
        stopped = stopped or time.monotonic() - began + more > seconds
        return stopped

    try:
        if measure == PREPARE:
            out |= _prepare(peer)
        else:
            table = measures.ADAPTIVE if peer.adaptive else measures.FIXED
            out |= table[measure](peer, cases.BY_NAME[case_name], late)
    except measures.RunFailed as failure:
        out["status"], out["reason"] = failure.args
    except Exception as error:
        out["status"], out["reason"] = "invalid", f"{type(error).__name__}: {error}"
    spent = time.monotonic() - began
    if stopped or spent > seconds:
        early = f"the budget of {seconds:.3g} s was used up: fewer runs"
        out["reason"] = "; ".join(filter(None, [out["reason"], early]))
    out = {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in out.items()}
    return out | {"seconds": round(spent, 3)}


def blank(peer: str | Method | Peer | Integrator, measure: str, case_name: str = "") -> dict:
    """A row without measured values yet."""
    peer = integrator(peer)
    return {
        "package": peer.kind,
        "version": version_of(peer.kind) or "absent",
        "peer": peer.id,
        "name": peer.name,
        "adaptive": peer.adaptive,
        "measure": measure,
        "problem": case_name,
        "status": "ok",
        "reason": "",
    }


def _prepare(peer: Integrator) -> dict:
    """Load the package and take one step on each case, so that all is compiled before the time counts: a row's end."""
    try:
        peer.load()
    except ImportError as error:
        return {"status": "skipped", "reason": f"{peer.kind} cannot be imported ({error})"}
    ready = dict.fromkeys(c for m in ("order", "stability") for c in cases.select(peer, m))
    if not ready:
        return {"status": "skipped", "reason": "it can do none of the problems of the audit"}
    for case in ready:
        with contextlib.suppress(measures.RunFailed):
            measures.run(peer, case, case.h, 1)
    return {}


@cache
def shared_worker() -> Worker:
    """The worker process that all audits share: it loads packages and computes reference states only once."""
    worker = Worker()
    atexit.register(worker.stop)
    return worker


def row_elsewhere(peer: Integrator, measure: str, case_name: str = "", seconds: float = LOADING) -> dict:
    """`row` in the worker process; its status is "invalid" if the process dies, "timeout" if it is killed."""
    worker = shared_worker()
    limit = PATIENCE * seconds + MORE + (LOADING if worker.process is None else 0.0)
    answer = worker.call(row, peer.id, measure, case_name, seconds, seconds=limit)
    if answer.error is None:
        return answer.value
    ended = {"status": "invalid", "reason": answer.error, "seconds": 0.0}
    if answer.error == LATE:
        reason = f"it did not return within {limit:.3g} s (budget {seconds:.3g} s) and was stopped"
        ended = {"status": "timeout", "reason": reason, "seconds": limit}
    return blank(peer, measure, case_name) | ended
