"""Repeatability: a second, independent sweep of a few scenes, drawn with a seed from those that take little time.

The second sweep takes nothing from the first: it searches steps, drops integrators, refines and times them again, in a
cell of its own.
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
    """The ids of the scenes that are measured twice."""
    return sorted(random.Random(SEED).sample(CHEAP, COUNT))


def measure_rows(scene: str) -> Rows:
    """The rows of the finals of a scene's second sweep, by table."""
    return {TABLE: front.measure_rows(scene)[front.FINALS]}
