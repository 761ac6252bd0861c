"""The status of a step, as a kernel returns it: solved, or why the step could not be taken."""

from __future__ import annotations

SOLVED, STALLED, NOT_FINITE, OUT_OF_STEP = 0, 1, 2, 3
