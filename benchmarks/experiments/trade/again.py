"""The same sweep twice: a few scenes, drawn by a seed, measured whole once more."""

from __future__ import annotations

import random

from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.benchmarks.rows.cells import Rows

from . import front

TABLE = "front_again"
#: How many scenes, drawn with which seed from those that end soon.
COUNT, SEED = 3, 11
SHORT = (
    "pendulum-short",
    "kepler-orbit",
    "henon-heiles-box-short",
    "henon-heiles-chaotic",
    "lotka-volterra",
    "double-pendulum-chaotic",
    "duffing",
    "rigid-body",
    "henon-heiles-box-long",
    "perturbed-kepler-short",
)


def scenes() -> list[str]:
    """The scenes that are measured again."""
    return sorted(random.Random(SEED).sample([s for s in SHORT if s in BY_ID], COUNT))


def measured(scene: str) -> Rows:
    """The finals of a scene, from its beginning."""
    return {TABLE: front.measured(scene)[front.FINALS]}
