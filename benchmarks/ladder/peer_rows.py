"""Measure peers (other packages' integrators) on scenes: which peers run, at which steps, and what is measured.

Peers are those of the packages that this project depends on, and of the packages in `OPTIONAL` that are installed.  A
fixed-step peer runs at a scene's steps, an adaptive one over `TOLERANCES` (its rows have ``tol``, and no h).  Each is
run twice: without output for the time, the counts and the error at the end, and with output for the invariants; on a
chaotic scene, a third run ends at the time at which the error is taken.  The first run has no output because an
integrator without interpolation would end steps at the output times.  A fixed-step peer stores at most `MOST` states,
one in every ``rows_every`` steps.
"""

from __future__ import annotations

import statistics
from math import ceil
from typing import Any

from phasebench.benchmarks.measure.accuracy import head, invariants, trajectory_error, truth
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.scenes import DRIFT, Scene
from phasebench.integrators.driver import INVALID, OK, SKIPPED
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.solution import Solution
from phasebench.reference.installed import how_to_install
from phasebench.reference.peers import PEERS, Peer, integrate_peer
from phasebench.reference.peers.record import NotHere

#: The peers' packages that this project depends on.
PACKAGES = ("heyoka", "rebound", "scipy")
#: Packages whose peers are measured, too, where they are installed: compiled, with compiled right-hand sides.
OPTIONAL = ("boost", "pynamicalsys")
TOLERANCES = (1e-6, 1e-9, 1e-12, 1e-15)
#: Number of steps or tolerances of a peer on the long scenes; slow peers, which run only the loosest tolerance there.
SIZES = 2
SLOW = ("scipy-dop853", "scipy-lsoda", "scipy-radau", "scipy-radau-numba")
#: The number of steps with which a peer of fixed steps runs in the quick tier.
RUNGS = 3
#: On long scenes, peers of a higher order run only at the largest step, as methods do.
HIGH = 4
#: Rows of a fixed-step peer, and of an adaptive one on a long scene (a prime, which samples a period at many phases).
MOST, ADAPTIVE = 5000, 997
#: A run of more seconds than this is timed only once.
LONG = 0.3


def swept() -> list[Peer]:
    """List the peers (integrators of other packages) that are measured on the scenes."""
    return [p for p in PEERS if p.package in (*PACKAGES, *OPTIONAL)]


def lacks(peer: Peer, scene: Scene) -> str | None:
    """Why a peer cannot run on a scene, or None if it can."""
    if not Integrator(peer).installed:
        return f"{peer.package} is not installed; {how_to_install(peer.package)}"
    made = problem_of(scene.problem)
    return peer.lacks(made, made.system)


def sizes(peer: Peer, scene: Scene, quick: bool = False) -> list[tuple[float | None, float | None]]:
    """Each (step h, tolerance) of a peer on a scene, one of them None; a single pair if it cannot run there."""
    if peer.adaptive:
        found = [(None, tol) for tol in TOLERANCES if tol >= peer.least]
        coarse = peer.id in SLOW
    else:
        found = [(h, None) for h in scene.ladder(quick)]
        coarse = (peer.order or 0) > HIGH
    made = problem_of(scene.problem)
    few = RUNGS if quick and not peer.adaptive else 1 if quick else len(found)
    if scene.purpose == DRIFT:
        few = min(few, 1 if coarse else SIZES)
    lack = peer.lacks(made, made.system)
    return found[: 1 if lack and not isinstance(lack, NotHere) else few]


def measure(scene: Scene, peer: Peer, h: float | None, tol: float | None, repeats: int) -> dict[str, Any]:
    """The row of a peer on a scene at a step or a tolerance; its time is the median of up to ``repeats`` runs."""
    problem = problem_of(scene.problem)
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


def _with_rows(
    problem: Problem, peer: Peer, scene: Scene, h: float | None, tol: float | None
) -> tuple[Solution, int | None]:
    if peer.adaptive:
        steps = ADAPTIVE if scene.purpose == DRIFT else round(scene.t_end / scene.steps[0])
        return integrate_peer(problem, peer, tol=tol, t_end=scene.t_end, steps=steps), None
    every = ceil(scene.t_end / h / MOST)
    return integrate_peer(problem, peer, h=h, t_end=scene.t_end, save_every=every), every
