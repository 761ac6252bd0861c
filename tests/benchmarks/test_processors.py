"""Stored numbers hold on every processor: some of them measured again (the gate does it as on several)."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.measure import accuracy
from phasebench.benchmarks.problems.scenes import BY_ID
from phasebench.integrators import integrate
from phasebench.reference import tables

pytestmark = pytest.mark.processor

#: Of each kernel one method: explicit, a splitting, implicit; the shortest and a long scene.
ROWS = [
    ("henon-heiles-chaotic-t1", "rk4", 0.01),
    ("henon-heiles-chaotic-t1", "implicit-midpoint", 0.01),
    ("pendulum-t1000", "stormer-verlet", 0.05),
    ("pendulum-t1000", "implicit-midpoint", 0.1),
]


def measured(scene, id: str, h: float) -> dict:
    made = scene.made()
    solution = integrate(made, id, h=h, t_end=scene.t_end)
    return accuracy.trajectory_error(scene, solution) | accuracy.invariants(made, solution, scene.t_end)


def outside(scene, row: dict, id: str, h: float) -> pd.DataFrame:
    """What of a row is not in the bands of the scene's stored table."""
    stored, _ = tables.read(scene.id)
    (known,) = stored[(stored["method"] == id) & (stored["h"] == h)].to_dict("records")
    bands = {
        "global_error": (scene.relative, scene.trajectory),
        "energy_max": (scene.relative, scene.absolute),
    }
    columns = [c for c in bands if not np.isnan(known[c])]
    frames = [pd.DataFrame([{"h": h} | {c: float(r[c]) for c in columns}]) for r in (row, known)]
    return tables.compare(*frames, ["h"], {c: bands[c] for c in columns})


@pytest.mark.parametrize(("name", "id", "h"), ROWS)
def test_a_stored_row_holds(name, id, h):
    scene = BY_ID[name]
    row = measured(scene, id, h)
    assert outside(scene, row, id, h).empty
    for column in ("global_error", "energy_max"):
        wrong = row | {column: row[column] * (1 + 3 * scene.relative) + 3 * scene.trajectory}
        assert set(outside(scene, wrong, id, h)["column"]) == {column}, "the control: a number off by thrice its band"
