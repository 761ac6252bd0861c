"""Kepler and perturbed Kepler beside the established integrators: heyoka, REBOUND's WHFast and IAS15, SciPy's DOP853.

The end is at an apocentre (100.5 orbits), where a phase error is not multiplied by the speed of a pericentre.
"""

from __future__ import annotations

import statistics
from math import pi

import numpy as np
import pytest

from benchmarks.problems import problem
from integrators.driver import OK, integrate
from integrators.registry import method
from reference import taylor
from reference.peers import PEERS, integrate_peer

ORBITS = 100.5
PER_ORBIT = (100, 300, 1000, 3000)
OURS = (
    ("stormer-verlet", {}),
    ("implicit-midpoint", {}),
    ("scheme-i", {"lam": "1/3"}),
    ("scheme-ii", {"lam": "1/3"}),
    ("scheme-iii", {"lam": "1/3"}),
    ("scheme-iii-yoshida-4", {}),
    ("scheme-iii-suzuki-6", {}),
    ("scheme-iii-suzuki-4", {"lam": "0"}),
    ("scheme-iii-yoshida-6", {"lam": "0"}),
    ("scheme-iii-suzuki-6", {"lam": "0"}),
    ("scheme-iv", {}),
    ("scheme-v", {}),
    ("scheme-v-suzuki-4", {}),
    ("avf", {}),
    ("rk4", {}),
)
TOLERANCES = (1e-6, 1e-9, 1e-12, 1e-15)


@pytest.mark.parametrize("name", ["kepler", "perturbed-kepler"])
def bench_peers(name, results, quick):
    """Error, invariants and warm time at equal step counts, and over tolerances where the peer is adaptive."""
    found = problem(name)
    t_end = (10.5 if quick else ORBITS) * 2 * pi
    truth = taylor.reference(found, [t_end])
    exact = np.concatenate([truth.q[-1], truth.p[-1]])
    system = found.system

    def row(label, kind, solution, seconds, setting):
        out = {"problem": found.label, "method": label, "kind": kind, "setting": setting, "status": solution.status}
        out |= {"reason": solution.reason, "steps": solution.counts.get("steps", 0)}
        if solution.status != OK:
            return out
        H = system.observe(system.H, solution.q, solution.p)
        L = system.observe(found.invariants["angular-momentum"], solution.q, solution.p)
        error = np.abs(np.concatenate([solution.q[-1], solution.p[-1]]) - exact).max()
        return out | {
            "error": float(error),
            "reference uncertainty": float(truth.uncertainty[-1]),
            "energy error": float(np.abs(H - H[0]).max()),
            "angular momentum error": float(np.abs(L - L[0]).max()),
            "seconds": seconds,
        }

    rounds = 1 if quick else 3
    rows = []
    for per_orbit in PER_ORBIT[: 2 if quick else None]:
        h = 2 * pi / per_orbit
        steps = round(t_end / h)
        for id, parameters in OURS:
            chosen = method(id, **parameters)
            solution = integrate(found, chosen, h=h, steps=steps)
            seconds = statistics.median(
                integrate(found, chosen, h=h, steps=steps, save_every=0).seconds for _ in range(rounds)
            )
            rows.append(row(chosen.label, "phasebench", solution, seconds, f"{per_orbit} steps an orbit"))
        for peer in (p for p in PEERS if not p.adaptive and not p.lacks(found, system)):
            solution = integrate_peer(found, peer.id, h=h, steps=steps)
            bare = [integrate_peer(found, peer.id, h=h, steps=steps, save_every=0).seconds for _ in range(rounds)]
            rows.append(row(peer.id, peer.package, solution, statistics.median(bare), f"{per_orbit} steps an orbit"))
    for peer in (p for p in PEERS if p.adaptive and not p.lacks(found, system)):
        for tol in TOLERANCES:
            if peer.package == "scipy" and tol < 1e-13:
                continue
            solution = integrate_peer(found, peer.id, tol=tol, t_end=t_end, steps=200)
            bare = [integrate_peer(found, peer.id, tol=tol, t_end=t_end, save_every=0).seconds for _ in range(rounds)]
            rows.append(row(peer.id, peer.package, solution, statistics.median(bare), f"tolerance {tol:g}"))
    results.add("peers", rows)
    ours = [r for r in rows if r["status"] == OK]
    assert ours, "nothing could be compared"
    best = min(r["error"] for r in ours if r["kind"] != "phasebench")
    assert best < 1e-6, f"no peer comes near the reference (best {best:.2e}): one of them integrates another problem"
