"""REBOUND's integrators as peers, through its public Python interface.

Source: H. Rein, S.-F. Liu, Astron. Astrophys. 537 (2012) A128.
"""

from __future__ import annotations

from .record import Peer, Run

KEPLER = ("kepler", "perturbed-kepler")


def _lacks(problem, system) -> str | None:
    id = getattr(problem, "id", None)
    return None if id in KEPLER else f"it integrates only {' and '.join(KEPLER)}, not '{id or 'a system'}'"


def _run(integrator: str):
    def run(problem, system, q, p, h, index, t, tol) -> Run:
        from .. import nbody

        Q, P, steps, seconds = nbody.run(problem, integrator, q, p, h, index, tol)
        return Run(Q, P, steps, 0, seconds)

    return run


def _peer(integrator: str, name: str, **fields) -> Peer:
    common = {"package": "rebound", "license": "GPL-3.0", "scope": ", ".join(KEPLER)}
    return Peer(f"rebound-{integrator}", name, run=_run(integrator), lacks=_lacks, **common, **fields)


PEERS = (
    _peer(
        "ias15",
        "IAS15, adaptive Gauss-Radau of order 15",
        adaptive=True,
        order=15,
        about="tol is REBOUND's epsilon, which is no error bound; the default 1e-9 reaches round-off",
        source="Rein & Spiegel 2015, Mon. Not. R. Astron. Soc. 446, 1424-1437",
    ),
    _peer(
        "whfast",
        "WHFast, Wisdom-Holman splitting",
        adaptive=False,
        order=4,
        about="exact up to round-off on kepler; with the extra force corrector 17 and the lazy kernel; safe_mode = 0",
        source="Rein & Tamayo 2015, Mon. Not. R. Astron. Soc. 452, 376-388; Rein, Tamayo & Brown 2019",
    ),
    _peer(
        "leapfrog",
        "REBOUND's leapfrog, drift-kick-drift",
        adaptive=False,
        order=2,
        about="one force evaluation a step",
        source="Rein & Liu 2012, Astron. Astrophys. 537, A128",
    ),
)
