"""A certificate within a time limit: measured in a process of its own, which is ended where a step never returns.

The process interrupts itself when the time is over, which ends a loop of Python and names its line; where that is not
heard, because the loop is compiled, the process is killed.  What was measured by then is in the certificate.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import re
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from math import isfinite
from pathlib import Path

from phasebench.integrators.engine import progress as compilation
from phasebench.integrators.errors import InvalidInput

#: Seconds between two interruptions, which a step may swallow; from the first one to a note of where it is; to its end.
AGAIN, NOTE, GRACE = 0.25, 1.0, 2.0
PLACE = re.compile(r'File "(?P<file>[^"]+)", line (?P<line>\d+)')


class OutOfTime(BaseException):
    """The time is over; ``places`` are (file, line) of what is running, the innermost first."""

    def __init__(self, places):
        super().__init__("the time limit passed")
        self.places = places


def said(limit: float, places, where: str = "", what: str = "") -> str:
    """That the time is over, and in which line of the file ``where``, or of the innermost that is known."""
    own = [p for p in places if p[0] == where] or [p for p in places if "phasebench" not in p[0]] or places[:1]
    at = f" at {own[0][0]}, line {own[0][1]}" if own else ""
    return f"the time limit of {limit:g} s passed{f' during {what}' if what else ''}{at}: it had not returned"


def within(limit: float, measure: Callable, unfinished: Callable, tell: Callable[[str], None]):
    """What ``measure`` returns, which runs in a process of its own for at most so many seconds.

    Parameters
    ----------
    measure : (tell, checkpoint) -> a certificate; ``checkpoint`` is handed what there is so far
    unfinished : (what there was at the last checkpoint or None, what it was doing, why, whether the time is over) -> a
        certificate
    tell : told what is measured

    Raises
    ------
    InvalidInput
        Where ``measure`` raises it, for a limit that is none, and where processes cannot be forked.
    """
    if not (isfinite(limit) and limit > 0):
        raise InvalidInput(f"the time limit is {limit!r}; it must be a positive number of seconds")
    if "fork" not in multiprocessing.get_all_start_methods():
        raise InvalidInput("a time limit needs a system that can fork processes, such as Linux or macOS")
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    last, doing = None, ""
    with tempfile.TemporaryDirectory() as folder:
        note = Path(folder) / "where"
        process = context.Process(target=_measure, args=(theirs, note, limit, measure), daemon=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads beside a fork: none of them is used
            process.start()
        theirs.close()
        end = time.monotonic() + limit + GRACE
        try:
            while ours.poll(max(0.0, end - time.monotonic())):
                kind, value = ours.recv()
                if kind == "done":
                    return value
                if kind == "invalid":
                    raise InvalidInput(value)
                if kind == "checkpoint":
                    last = value
                else:
                    doing = value
                    tell(value)
        except EOFError:
            process.join()
            why = f"its process ended with exit code {process.exitcode}{f' during {doing}' if doing else ''}"
            return unfinished(last, doing, why, False)
        finally:
            process.kill()
            process.join()
            ours.close()
        places = [(m["file"], int(m["line"])) for m in PLACE.finditer(note.read_text() if note.exists() else "")]
        return unfinished(last, doing, places, True)


def _measure(pipe, note: Path, limit: float, measure: Callable) -> None:
    """Measure, in the forked process, and send what comes of it."""
    compilation.announce = nullcontext

    def interrupt(number, frame):
        stack = traceback.extract_stack(frame)
        raise OutOfTime([(f.filename, f.lineno) for f in reversed(stack)])

    def send(kind: str, value) -> None:
        pipe.send((kind, value))

    with note.open("w") as stream:
        faulthandler.dump_traceback_later(limit + NOTE, file=stream)
        signal.signal(signal.SIGALRM, interrupt)
        signal.setitimer(signal.ITIMER_REAL, limit, AGAIN)
        try:
            found = measure(lambda what: send("doing", what), lambda value: send("checkpoint", value))
        except InvalidInput as error:
            quiet()
            return send("invalid", str(error))
        quiet()
        faulthandler.cancel_dump_traceback_later()
        send("done", found)


def quiet() -> None:
    """No further interruption."""
    signal.setitimer(signal.ITIMER_REAL, 0)
