"""Measures one at a time within a budget, in a process that can be stopped where a package does not return.

A measure looks at the clock between its runs and ends early with what it has.  A run that does not return is ended
from outside: the process is killed, the row says so, and a new process goes on.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
import time
from functools import cache
from math import isfinite

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.reference.tables import version_of

from . import cases, measures

#: Seconds that loading a package and compiling a peer for its cases may take.
LOADING = 120.0
#: A measure is ended from outside after so many times its budget, and some seconds.
PATIENCE, MORE = 1.5, 3.0
#: A measure of this name loads the package and takes a step on each case.
PREPARE = "package"


def row(peer, measure: str, case_name: str = "", seconds: float = float("inf")) -> dict:
    """The row of a measure of a peer on a case, in this process; ``seconds`` are looked at between runs.

    They do not include what is true, which is computed once for all peers.
    """
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
    except measures.Failed as failure:
        out["status"], out["reason"] = failure.args
    except Exception as error:
        out["status"], out["reason"] = "invalid", f"{type(error).__name__}: {error}"
    spent = time.monotonic() - began
    if stopped or spent > seconds:
        early = f"the budget of {seconds:.3g} s was used up: fewer runs"
        out["reason"] = "; ".join(filter(None, [out["reason"], early]))
    out = {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in out.items()}
    return out | {"seconds": round(spent, 3)}


def blank(peer, measure: str, case_name: str = "") -> dict:
    """A row without what is measured."""
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


def _prepare(peer) -> dict:
    try:
        peer.load()
    except ImportError as error:
        return {"status": "skipped", "reason": f"{peer.kind} cannot be imported ({error})"}
    ready = dict.fromkeys(c for m in ("order", "stability") for c in cases.chosen(peer, m))
    if not ready:
        return {"status": "skipped", "reason": "it can do none of the problems of the audit"}
    for case in ready:
        with contextlib.suppress(measures.Failed):
            measures.run(peer, case, case.h, 1)
    return {}


def serve() -> None:
    """Answer the jobs of stdin, a JSON list a line, with a row a line; what packages print goes to stderr."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        id, *rest = json.loads(line)
        answers.write(json.dumps(row(integrator(id), *rest)) + "\n")
        answers.flush()


class Worker:
    """A process that measures peers by their ids."""

    def __init__(self):
        self.process, self.answers = None, queue.Queue()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()

    def start(self) -> None:
        """Start the process."""
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from phasebench.benchmarks.experiments.audit.worker import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.answers = queue.Queue()
        threading.Thread(target=_listen, args=(self.process.stdout, self.answers), daemon=True).start()

    def stop(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process = None

    def row(self, peer, measure: str, case_name: str = "", seconds: float = LOADING) -> dict:
        """`row` in the process, which is killed where it takes too long; a dead process is a row as well."""
        limit = PATIENCE * seconds + MORE
        if self.process is None:
            self.start()
            limit += LOADING
        answer = None
        with contextlib.suppress(OSError):
            self.process.stdin.write(json.dumps([peer.id, measure, case_name, seconds]) + "\n")
            self.process.stdin.flush()
            try:
                answer = self.answers.get(timeout=limit)
            except queue.Empty:
                self.stop()
                reason = f"it did not return within {limit:.3g} s (budget {seconds:.3g} s) and was stopped"
                return blank(peer, measure, case_name) | {"status": "timeout", "reason": reason, "seconds": limit}
        if answer is None:
            self.stop()
            return blank(peer, measure, case_name) | {"status": "invalid", "reason": "its process died", "seconds": 0.0}
        return json.loads(answer)


@cache
def shared() -> Worker:
    """The process of this one's audits: packages are loaded, and what is true is computed, once for all peers."""
    worker = Worker()
    atexit.register(worker.stop)
    return worker


def _listen(stream, answers) -> None:
    """Put the lines of ``stream`` into ``answers``, and None where it ends."""
    with contextlib.suppress(ValueError):
        for line in stream:
            answers.put(line)
    answers.put(None)
