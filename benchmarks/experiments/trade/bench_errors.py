"""Every method and peer on every scene: errors, orders, invariants; methods are held to the stored error tables.

Peers are in the report's rows and not in the stored tables: their numbers follow the releases of other packages, and a
number that moved there is no regression here.
"""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.integrators.registry import METHODS
from phasebench.reference import tables

KEYS = ["method", "h"]
TRAJECTORY = ("global_error", "refinement_difference")
INVARIANTS = ("energy_max", "energy_max_early", "angular-momentum_max")
#: Where trajectories part, round-off decides what happens late: only the early energy error can be held.
CHAOTIC = ("energy_max_early",)
#: Schemes IV and V choose between roots; where two are equally near, round-off decides which.
CHOICE = 0.5


def _regressed(scene) -> tuple[str, ...]:
    return (*TRAJECTORY, *INVARIANTS) if scene.regular else CHAOTIC


def _table(rows, scene) -> pd.DataFrame:
    """The rows of methods, with the columns that are stored."""
    frame = pd.DataFrame([r for r in rows if r.get("kind", sweep.KIND) == sweep.KIND])
    status = ["status"] if scene.regular else []
    uncertain = ["reference_uncertainty"] if scene.regular else []
    columns = [*KEYS, *status, *(c for c in (*_regressed(scene), *uncertain) if c in frame.columns)]
    return frame[columns].sort_values(KEYS).reset_index(drop=True)


def _violations(measured, stored, scene) -> pd.DataFrame:
    """Numbers out of their bands; the trajectories of methods that choose a root have a wider one."""
    parts = []
    choosing = {m.id for m in METHODS if m.family in ("schemes_iv_v", "equip")}
    for chooses in (False, True):
        here = [frame[frame["method"].isin(choosing) == chooses].reset_index(drop=True) for frame in (measured, stored)]
        bands = {
            c: (
                CHOICE if chooses and c in TRAJECTORY else scene.relative,
                scene.trajectory if c in TRAJECTORY else scene.absolute,
            )
            for c in measured.columns
            if c in _regressed(scene)
        }
        parts.append(tables.compare(*here, KEYS, bands))
    return pd.concat(parts, ignore_index=True)


def _shown(difference: str) -> str:
    """The difference without the changes that the last digits make."""
    lines = difference.split("\n")
    kept = [line for line in lines if not line.endswith(("(+0.00%)", "(-0.00%)"))]
    left = len(lines) - len(kept)
    return "\n".join(kept) + (f"\n  and {left} numbers moved by less than 0.005 %" if left else "")


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.id)
def bench_scene(scene, results, quick, update):
    """Measure the scene's rows; a number that leaves its band fails, naming the row and both numbers."""
    rows = sweep.run(sweep.tasks([scene], quick), repeats=1 if quick else sweep.REPEATS)
    results.add("rows", rows)
    measured = _table(rows, scene)
    if update and not quick:
        bands = {"relative": scene.relative, "absolute": scene.absolute, "trajectory": scene.trajectory}
        about = tables.provenance(scene.made(), scene=scene.id, **bands)
        try:
            old = tables.read(scene.id)[0]
        except (FileNotFoundError, tables.CorruptTable):
            old = None
        results.notes.append(f"{scene.id}: {_shown(tables.difference(old, measured, KEYS))}")
        tables.write(scene.id, measured, about)
        return
    stored, _ = tables.read(scene.id)
    if quick:
        stored = stored[stored["h"].isin(scene.ladder(quick=True))].reset_index(drop=True)
    violations = _violations(measured, stored, scene)
    assert violations.empty, (
        f"{len(violations)} numbers of {scene.id} left their bands (re-record with --update-tables if that is right):\n"
        + violations.to_string(index=False, float_format=lambda x: f"{x:.6e}")
    )
