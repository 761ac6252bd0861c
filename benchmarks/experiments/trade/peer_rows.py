"""Peers in a sweep: which of them, at which steps or tolerances, and their rows.

In a sweep are the peers of the packages that this project depends on.  A fixed-step peer runs at a scene's steps, an
adaptive one over `TOLERANCES` (a row has ``tol``, and no h).  Two runs are made: one without output, which gives the
time, the counts and the error at the end, and one with rows, which gives the invariants; where trajectories part, a
third to the time at which their error is told.  Output of an integrator that has no interpolation ends its steps at the
rows, hence the first.  Rows are at most `MOST`, every ``rows_every``-th step of a fixed-step peer.
"""

from __future__ import annotations

import statistics
from importlib.util import find_spec
from math import ceil
from typing import Any

from phasebench.benchmarks.measure.accuracy import head, invariants, trajectory_error, truth
from phasebench.benchmarks.problems.scenes import DRIFT, Scene
from phasebench.integrators.driver import INVALID, OK, SKIPPED
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.peers import PEERS, Peer, integrate_peer

#: The hard dependencies among the packages; peers of others are in the audit alone.
PACKAGES = ("heyoka", "rebound", "scipy")
TOLERANCES = (1e-6, 1e-9, 1e-12, 1e-15)
#: Sizes that peers run on the long scenes, and those that run the loosest tolerance there alone, being slow.
SIZES = 2
SLOW = ("scipy-dop853", "scipy-lsoda", "scipy-radau", "scipy-radau-numba")
#: What the quick tier runs, and at how many steps.
QUICK, RUNGS = ("heyoka", "rebound-leapfrog", "rebound-whfast", "scipy-dop853"), 3
#: Peers of a higher order run the long scenes at the largest step only, as methods do.
HIGH = 4
#: Rows of a fixed-step peer; of an adaptive one on a long scene (a prime, so that no period is sampled at few phases).
MOST, ADAPTIVE = 5000, 997
#: A run of more seconds is not repeated for its time.
LONG = 0.3


def swept(quick: bool = False) -> list[Peer]:
    """The peers of a sweep; of a quick one a few."""
    return [p for p in PEERS if p.package in PACKAGES and (not quick or p.id in QUICK)]


def lacks(peer: Peer, scene: Scene) -> str | None:
    """Why a peer cannot do a scene, or None."""
    try:
        here = find_spec(peer.package) is not None
    except ValueError:  # it was taken out of the imported modules
        here = False
    if not here:
        return f"{peer.package} is not installed; pip install {peer.package}"
    made = scene.made()
    return peer.lacks(made, made.system)


def sizes(peer: Peer, scene: Scene, quick: bool = False) -> list[tuple[float | None, float | None]]:
    """(h, tol) of a peer's rows on a scene; a single row where it cannot do it."""
    if peer.adaptive:
        found = [(None, tol) for tol in TOLERANCES if tol >= peer.least]
        coarse = peer.id in SLOW
    else:
        found = [(h, None) for h in scene.ladder(quick)]
        coarse = (peer.order or 0) > HIGH
    few = RUNGS if quick and not peer.adaptive else 1 if quick else len(found)
    if scene.purpose == DRIFT:
        few = min(few, 1 if coarse else SIZES)
    return found[: 1 if lacks(peer, scene) else few]


def measure(scene: Scene, peer: Peer, h: float | None, tol: float | None, repeats: int) -> dict[str, Any]:
    """What is measured of a peer on a scene at a step or a tolerance."""
    problem = scene.made()
    row = head(scene, problem, peer, peer.package, peer.package)
    row |= {"h": h, "tol": tol}
    lack = lacks(peer, scene)
    if lack:
        return row | {"status": SKIPPED, "reason": lack}
    bare = {"h": h, "tol": tol, "t_end": scene.t_end, "save_every": 0}
    try:
        end = integrate_peer(problem, peer, **bare)
        with_rows, every = _with_rows(problem, peer, scene, h, tol)
    except InvalidInput as error:
        return row | {"status": INVALID, "reason": str(error)}
    worse = end if end.status != OK else with_rows
    row |= {"status": worse.status, "reason": worse.reason, "rows_every": every} | end.counts
    row |= invariants(problem, with_rows, scene.t_end)
    if worse.status != OK:
        return row
    told = truth(scene.id).t
    row |= trajectory_error(
        scene, end if told == scene.t_end else integrate_peer(problem, peer, **bare | {"t_end": told})
    )
    runs = [end.seconds]
    if end.seconds < LONG:
        runs += [integrate_peer(problem, peer, **bare).seconds for _ in range(repeats - 1)]
    return row | {"seconds": statistics.median(runs)}


def _with_rows(problem, peer: Peer, scene: Scene, h: float | None, tol: float | None):
    """(the run with rows, how many steps a row is apart, or None of an adaptive peer)."""
    if peer.adaptive:
        steps = ADAPTIVE if scene.purpose == DRIFT else round(scene.t_end / scene.steps[0])
        return integrate_peer(problem, peer, tol=tol, t_end=scene.t_end, steps=steps), None
    every = ceil(scene.t_end / h / MOST)
    return integrate_peer(problem, peer, h=h, t_end=scene.t_end, save_every=every), every
