"""Every method on every scene: errors, orders, invariants; held to the stored error tables."""

from __future__ import annotations

import pandas as pd
import pytest

from benchmarks import sweep
from benchmarks.scenes import SCENES
from reference import tables

KEYS = ["method", "h"]
REGRESSED = ("global_error", "refinement_difference", "energy_max", "angular-momentum_max")


def _table(rows) -> pd.DataFrame:
    frame = pd.DataFrame(rows)
    columns = [*KEYS, "status", *(c for c in REGRESSED if c in frame.columns)]
    return frame[columns].sort_values(KEYS).reset_index(drop=True)


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.id)
def bench_scene(scene, results, quick, update):
    """Measure the scene's rows; a number that leaves its band fails, naming the row and both numbers."""
    rows = sweep.run(sweep.tasks([scene], quick), repeats=1 if quick else sweep.REPEATS)
    results.add("rows", rows)
    measured = _table(rows)
    if update and not quick:
        about = tables.provenance(scene.made(), scene=scene.id, relative=scene.relative, absolute=scene.absolute)
        try:
            old = tables.read(scene.id)[0]
        except (FileNotFoundError, tables.CorruptTable):
            old = None
        results.notes.append(f"{scene.id}: {tables.difference(old, measured, KEYS)}")
        tables.write(scene.id, measured, about)
        return
    stored, _ = tables.read(scene.id)
    if quick:
        stored = stored[stored["h"].isin(scene.ladder(quick=True))].reset_index(drop=True)
    bands = {c: (scene.relative, scene.absolute) for c in measured.columns if c in REGRESSED}
    violations = tables.compare(measured, stored, KEYS, bands)
    assert violations.empty, (
        f"{len(violations)} numbers of {scene.id} left their bands (re-record with --update-tables if that is right):\n"
        + violations.to_string(index=False, float_format=lambda x: f"{x:.6e}")
    )
