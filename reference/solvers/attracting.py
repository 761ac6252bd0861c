"""heyoka's Taylor series of bodies that attract each other, with masses that a run chooses: one compilation for all.

A body of mass 0 moves as a test particle, so that leaving one out is, for the others, a run with its mass at 0.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from . import taylor

SPACE = 3
#: The tolerance of a run: as good as doubles are.
TOLERANCE = 1e-15


class Attracting:
    """An integrator of N bodies in space; G is their constant of gravity."""

    def __init__(self, N: int, G: float):
        import heyoka as hy

        self.N = N
        system = hy.model.nbody(N, masses=[hy.par[i] for i in range(N)], Gconst=G)
        self.flow = hy.taylor_adaptive(
            system, np.zeros(2 * SPACE * N), pars=[0.0] * N, tol=TOLERANCE, compact_mode=True
        )

    def rows(
        self, masses: Sequence[float], x: np.ndarray, v: np.ndarray, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Positions and velocities, (n, 3 N) each, at rising times from 0 on, and the seconds that they took.

        Raises
        ------
        reference.solvers.taylor.ReferenceFailed
            Where a run does not come to the end.
        """
        flow, N = self.flow, self.N
        flow.pars[:] = masses
        flow.time = 0.0
        flow.state[:] = np.concatenate([np.reshape(x, (N, SPACE)), np.reshape(v, (N, SPACE))], axis=1).ravel()
        began = time.perf_counter()
        found, _, failure = taylor.propagate(flow, np.asarray(times, float))
        seconds = time.perf_counter() - began
        if failure is not None or not np.isfinite(found).all():
            raise taylor.ReferenceFailed(
                f"bodies could not be followed to t = {times[-1]:g}: {failure or 'not finite'}"
            )
        found = found.reshape(len(found), N, 2 * SPACE)
        return found[:, :, :SPACE].reshape(len(found), -1), found[:, :, SPACE:].reshape(len(found), -1), seconds
