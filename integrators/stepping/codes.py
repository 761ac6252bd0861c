"""The status of a step, as a kernel returns it: solved, or why the step could not be taken."""

from __future__ import annotations

#: `ASKED` is none of a step: Newton's method is to be told G where it asks for it (`newton`).
SOLVED, STALLED, NOT_FINITE, OUT_OF_STEP, ASKED = 0, 1, 2, 3, 4
