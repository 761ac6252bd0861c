"""SCENES: what is integrated, how far and with which steps, and how far a stored number may move.

An *order* scene ends soon and halves its step; a *drift* scene is long and watches the invariants.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from . import problem
from .base import Problem

ORDER, DRIFT = "order", "drift"


@dataclass(frozen=True)
class Scene:
    """A problem on an orbit over a time span with a ladder of steps.

    Attributes
    ----------
    id, problem : the scene's name and ``id:orbit`` of its problem
    purpose : "order" or "drift"
    t_end : where it ends
    steps : the step sizes h, falling; in an order scene each is half of the one before
    relative, absolute : the band |measured - stored| <= absolute + relative * |stored| of the stored error tables
    trajectory : the same as ``absolute`` for errors of the trajectory, in which round-off grows
    regular : whether nearby trajectories stay together (else trajectory errors count only to the reference's horizon)
    """

    id: str
    problem: str
    purpose: str
    t_end: float
    steps: tuple[float, ...]
    relative: float = 1e-3
    absolute: float = 2e-13
    trajectory: float = 2e-12
    regular: bool = True

    def made(self) -> Problem:
        """The scene's problem."""
        return problem(self.problem)

    def ladder(self, quick: bool) -> tuple[float, ...]:
        """The step sizes of a full run, or the coarser ones of a quick one."""
        if not quick:
            return self.steps
        return self.steps[:4] if self.purpose == ORDER else self.steps[:1]


def _halved(h: float, times: int) -> tuple[float, ...]:
    return tuple(h / 2**k for k in range(times))


SCENES: tuple[Scene, ...] = (
    Scene("oscillator-t2", "harmonic-oscillator", ORDER, 2.0, _halved(0.2, 6)),
    Scene("pendulum-t2", "pendulum:swinging", ORDER, 2.0, _halved(0.2, 6)),
    Scene("kepler-t1", "kepler", ORDER, 1.0, _halved(0.04, 6)),
    Scene("perturbed-kepler-t1", "perturbed-kepler", ORDER, 1.0, _halved(0.04, 6)),
    Scene("henon-heiles-chaotic-t1", "henon-heiles:chaotic", ORDER, 1.0, _halved(0.02, 5)),
    Scene("henon-heiles-box-t1", "henon-heiles:box", ORDER, 1.0, _halved(0.02, 5)),
    Scene("lotka-volterra-t1", "lotka-volterra:4-2", ORDER, 1.2, _halved(0.12, 6)),
    Scene("pendulum-t1000", "pendulum:swinging", DRIFT, 1000.0, (0.1, 0.05, 0.02)),
    Scene("kepler-100-orbits", "kepler", DRIFT, 200 * pi, (pi / 60, pi / 150, pi / 300), trajectory=1e-9),
    Scene("perturbed-kepler-t1000", "perturbed-kepler", DRIFT, 1000.0, (0.05, 0.02, 0.01, 0.005), trajectory=1e-9),
    Scene("henon-heiles-box-t1000", "henon-heiles:box", DRIFT, 1000.0, (0.05, 0.02, 0.01, 0.005)),
    Scene(
        "henon-heiles-chaotic-t1000",
        "henon-heiles:chaotic",
        DRIFT,
        1000.0,
        (0.05, 0.02, 0.01, 0.005),
        regular=False,
    ),
    Scene("lotka-volterra-t120", "lotka-volterra:4-2", DRIFT, 120.0, (0.12, 0.06, 0.03)),
)

BY_ID = {s.id: s for s in SCENES}
