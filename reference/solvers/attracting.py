"""heyoka's Taylor series for gravitating bodies, with masses that are parameters, so that one compilation suffices.

A body of mass 0 moves as a test particle: for the others, setting a mass to 0 means removing that body.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from . import taylor

SPACE = 3
#: The tolerance, at the limit of double precision.
TOLERANCE = 1e-15


class Attracting:
    """heyoka's Taylor integrator of N gravitating bodies in space, compiled once; `rows` integrates bodies of any mass.

    G is the gravitational constant.
    """

    def __init__(self, N: int, G: float) -> None:
        import heyoka as hy

        self.N = N
        system = hy.model.nbody(N, masses=[hy.par[i] for i in range(N)], Gconst=G)
        self.flow = hy.taylor_adaptive(
            system, np.zeros(2 * SPACE * N), pars=[0.0] * N, tol=TOLERANCE, compact_mode=True
        )

    def rows(
        self, masses: Sequence[float], x: np.ndarray, v: np.ndarray, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Integrate the bodies: (positions, velocities, seconds) at increasing times, the first of which is 0.

        ``masses`` has N numbers, of which any may be 0; x and v, the initial positions and velocities, have 3 N.
        Positions and velocities come back as arrays (n, 3 N); seconds are those of the integration.

        Raises
        ------
        reference.solvers.taylor.ReferenceFailed
            If a run does not reach the end.
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
