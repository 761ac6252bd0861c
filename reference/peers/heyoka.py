"""heyoka's Taylor series as a peer.

Source: F. Biscani, D. Izzo, Mon. Not. R. Astron. Soc. 504 (2021) 2614-2628.
"""

from __future__ import annotations

import time

import numpy as np

from .record import Peer, Run

EPS = float(np.finfo(float).eps)


def _run(problem, system, q, p, h, index, t, tol) -> Run:
    from .. import taylor

    ta = taylor.integrator(system, float, tol)
    taylor.start(ta, float, q, p)
    started = time.perf_counter()
    rows, steps, failure = taylor.propagate(ta, t)
    seconds = time.perf_counter() - started
    return Run(rows[:, : system.d], rows[:, system.d :], steps, 0, seconds, failure)


PEERS = (
    Peer(
        "heyoka",
        "Taylor series of adaptive step and order, double precision",
        package="heyoka",
        adaptive=True,
        order=None,
        license="MPL-2.0",
        about="tol is the local error relative to the state; the default is the machine epsilon; compiled by LLVM",
        source="Biscani & Izzo 2021, Mon. Not. R. Astron. Soc. 504, 2614-2628",
        run=_run,
        tol=EPS,
        least=EPS / 2,
    ),
)
