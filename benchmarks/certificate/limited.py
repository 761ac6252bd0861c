"""Certification under a time limit, in a process of its own that can be killed if a step never returns.

When the time is over the process interrupts itself.  This ends a loop in Python, and the message names the line that
was running; a compiled loop ignores the interruption, and the process is killed.  The certificate has what was measured
by then.
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
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from phasebench.integrators.compile import progress as compilation
from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from types import FrameType

    from .result import Certificate

#: Seconds between interruptions, since a step may catch one; from the first to a dump of the stack; to the kill.
AGAIN, NOTE, GRACE = 0.25, 1.0, 2.0
#: The longest time limit, in seconds: operating systems do not wait much longer.
LONGEST = 1e6
PLACE = re.compile(r'File "(?P<file>[^"]+)", line (?P<line>\d+)')


class OutOfTime(BaseException):
    """Raised when the time is over; ``places`` are (file, line) of the stack, the innermost first."""

    def __init__(self, places: Sequence[tuple[str, int]]) -> None:
        super().__init__("the time limit passed")
        self.places = places


def time_over_message(limit: float, places: Sequence[tuple[str, int]], where: str = "", what: str = "") -> str:
    """The message that the time limit is over, with the line that was running: one in the file ``where``, if any."""
    own = [p for p in places if p[0] == where] or [p for p in places if "phasebench" not in p[0]] or places[:1]
    at = f" at {own[0][0]}, line {own[0][1]}" if own else ""
    return f"the time limit of {limit:g} s passed{f' during {what}' if what else ''}{at}: it had not returned"


def within(limit: float, measure: Callable, unfinished: Callable, tell: Callable[[str], None]) -> Certificate:
    """Call ``measure`` in a forked process for at most ``limit`` seconds and return its certificate.

    Parameters
    ----------
    measure : (tell, checkpoint) -> certificate; it calls ``checkpoint`` with what was measured so far
    unfinished : (last checkpoint or None, what was being measured, why it ended, whether the time is over) ->
        certificate, called if ``measure`` does not return; "why" is a text, or the places of the stack at a time-out
    tell : called with what is being measured
    """
    if not 0 < limit <= LONGEST:
        raise InvalidInput(f"the time limit is {limit!r}; it must be a positive number of seconds, at most {LONGEST:g}")
    if "fork" not in multiprocessing.get_all_start_methods():
        raise InvalidInput("a time limit needs a system that can fork processes, such as Linux or macOS")
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    last, doing = None, ""
    with tempfile.TemporaryDirectory() as folder:
        note = Path(folder) / "where"
        process = context.Process(target=_measure, args=(theirs, note, limit, measure), daemon=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # about forking beside threads: the child uses none
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


def _measure(pipe: Connection, note: Path, limit: float, measure: Callable) -> None:
    """Measure in the forked process, and send progress, checkpoints and the result through the pipe."""
    compilation.announce = nullcontext

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        stack = traceback.extract_stack(frame)
        raise OutOfTime([(f.filename, f.lineno) for f in reversed(stack)])

    def send(kind: str, value: object) -> None:
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
    """Cancel the timer that interrupts this process when its time is over."""
    signal.setitimer(signal.ITIMER_REAL, 0)
