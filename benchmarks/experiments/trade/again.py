"""Repeatability: a second, independent measurement of a few scenes, drawn with a seed from those that take little time.

It takes nothing from the first: it searches steps, drops integrators, refines and times them again, in a measurement
(`Cell`) of its own.
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
    """The ids of the scenes that are measured twice, to see whether the results repeat."""
    return sorted(random.Random(SEED).sample(CHEAP, COUNT))


def measure_rows(scene: str) -> Rows:
    """Measure a scene a second time from scratch: rows of the finalists at each accuracy, by table name."""
    return {TABLE: front.measure_rows(scene)[front.FINALS]}
