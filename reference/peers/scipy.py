"""SciPy's integrators as peers.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), II.5.
"""

from __future__ import annotations

import numpy as np

from .record import Peer, Run


def _dop853(problem, system, q, p, h, index, t, tol) -> Run:
    from .. import scipy_ivp

    return Run(*scipy_ivp.run(system, q, p, t, tol))


PEERS = (
    Peer(
        "scipy-dop853",
        "DOP853, Dormand-Prince of order 8(5,3)",
        package="scipy",
        adaptive=True,
        order=8,
        license="BSD-3-Clause",
        about="rtol = atol = tol, by default SciPy's rtol = 1e-3 and atol = 1e-6; the right-hand side is a Python call",
        source="Hairer, Norsett & Wanner 1993, II.5",
        run=_dop853,
        least=100 * float(np.finfo(float).eps),
    ),
)
