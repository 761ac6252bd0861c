"""Repeatability: measure the fastest integrators of a few scenes a second time, independently.

A scene is a problem, end time, quantity and accuracies; the few are drawn at random, with a fixed seed, from the scenes
that take little time.  Nothing of the first measurement is used: step sizes are searched, and slow integrators dropped,
once more.
"""

from __future__ import annotations

import random

from phasebench.benchmarks.store.cells import Rows

from . import front

TABLE = "front_again"
#: Number of scenes and seed of the draw; the scenes whose sweep takes about 15 seconds or less.
COUNT, SEED = 8, 11
CHEAP = (
    "oscillator-phase",
    "pendulum-short",
    "pendulum-long",
    "kepler-orbit",
    "kepler-phase",
    "perturbed-kepler-short",
    "henon-heiles-box-short",
    "henon-heiles-box-long",
    "henon-heiles-section",
    "henon-heiles-chaotic",
    "lotka-volterra",
    "lotka-volterra-log",
    "double-pendulum-chaotic",
    "duffing",
    "quadrupole-boson",
    "toda",
    "rigid-body",
    "schwarzschild-azimuth",
)


def scenes() -> list[str]:
    """Return the ids of the scenes that are measured twice, to see whether the results repeat."""
    return sorted(random.Random(SEED).sample(CHEAP, COUNT))


def measure_rows(scene: str) -> Rows:
    """Measure the scene with the id ``scene`` a second time from scratch.

    Returns {`TABLE`: rows}: a row for each finalist (one of the few fastest integrators) at each accuracy.
    """
    return {TABLE: front.measure_rows(scene)[front.FINALS]}
