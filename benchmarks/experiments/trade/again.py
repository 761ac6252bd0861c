"""The same sweep twice: scenes drawn by a seed from those that are cheap to measure, each measured whole once more.

Nothing is carried over: the second sweep climbs, drops, refines and times as the first did, in a cell of its own that
is measured apart from the first.
"""

from __future__ import annotations

import random

from phasebench.benchmarks.rows.cells import Rows

from . import front

TABLE = "front_again"
#: How many scenes, drawn with which seed from those whose sweep takes some 15 seconds or less.
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
    """The scenes that are measured again."""
    return sorted(random.Random(SEED).sample(CHEAP, COUNT))


def measured(scene: str) -> Rows:
    """The finals of a scene, from its beginning."""
    return {TABLE: front.measured(scene)[front.FINALS]}
