"""The statuses with which runs end: for each word what it means and what the user can do."""

from __future__ import annotations

from typing import NamedTuple

OK, INACCURATE, UNSTABLE, DIVERGED = "ok", "inaccurate", "unstable", "diverged"
NOT_CONVERGED, NO_ROOT = "not-converged", "no-root"
COLLISION, INVALID, TIMEOUT, SKIPPED = "collision", "invalid", "timeout", "skipped"


class Status(NamedTuple):
    """The meaning of a status: what happened, and what to do."""

    meaning: str
    remedy: str


#: Status -> what it means.  `integrators.outcome` says how "inaccurate" and "unstable" are told apart.
STATUSES: dict[str, Status] = {
    OK: Status("The run reached its end, and its energy gives no reason to reject it.", "Ask for its error."),
    INACCURATE: Status(
        "It reached its end, but at some row the energy error is at least half the size of H's own terms.",
        "Take a smaller step.",
    ),
    UNSTABLE: Status(
        "The energy error is of the size of H's terms and grows.", "Take a step below the method's stability limit."
    ),
    DIVERGED: Status("The state is no longer finite, or has left every bound.", "Take a smaller step."),
    NOT_CONVERGED: Status(
        "The equations of an implicit step were not solved to round-off.", "Take a smaller step, or another solver."
    ),
    NO_ROOT: Status("A parameter that keeps the energy does not exist at too many steps.", "Take a smaller step."),
    COLLISION: Status("The orbit meets a singularity of H.", "Take variable steps, or regularize."),
    INVALID: Status("The integration is not defined for this input.", "Mend the input; the reason says what is wrong."),
    TIMEOUT: Status("The time limit ended the run; its last row is where.", "Give it more time."),
    SKIPPED: Status(
        "The integrator does not apply to this problem, or its package is missing.", "The reason says what is missing."
    ),
}
