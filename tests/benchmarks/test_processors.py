"""Stored numbers hold on every processor: a few rows are measured again, in continuous integration on several."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import accuracy
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.scenes import BY_ID
from phasebench.benchmarks.store import compare, error_tables
from phasebench.integrators import integrate

pytestmark = pytest.mark.processor

#: One method of each kind (explicit, splitting, implicit) on the shortest and on a long scene.
ROWS = [
    ("henon-heiles-chaotic-t1", "rk4", 0.01),
    ("henon-heiles-chaotic-t1", "implicit-midpoint", 0.01),
    ("pendulum-t1000", "stormer-verlet", 0.05),
    ("pendulum-t1000", "implicit-midpoint", 0.1),
]


def measure(scene, id: str, h: float) -> dict:
    made = problem_of(scene.problem)
    solution = integrate(made, id, h=h, t_end=scene.t_end)
    return accuracy.trajectory_error(scene, solution) | accuracy.invariants(made, solution, scene.t_end)


def outside(scene, row: dict, id: str, h: float) -> set[str]:
    """The columns of a newly measured row that differ from the scene's stored table by more than the tolerance."""
    stored, _ = error_tables.load(scene.id)
    (known,) = stored[(stored["method"] == id) & (stored["h"] == h)].to_dict("records")
    bands = {
        "global_error": compare.Band(scene.relative, scene.trajectory),
        "energy_max": compare.Band(scene.relative, scene.absolute),
    }
    held = {c: band for c, band in bands.items() if not np.isnan(known[c])}
    return {d.column for d in compare.differences(compare.match([row], [known], []), held)}


@pytest.mark.parametrize(("name", "id", "h"), ROWS)
def test_stored_row_is_reproduced(name, id, h):
    scene = BY_ID[name]
    row = measure(scene, id, h)
    assert outside(scene, row, id, h) == set()
    for column in ("global_error", "energy_max"):
        wrong = row | {column: row[column] * (1 + 3 * scene.relative) + 3 * scene.trajectory}
        assert outside(scene, wrong, id, h) == {column}, "the control: a number off by thrice its band"
