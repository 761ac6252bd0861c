"""Every method and peer on every scene: errors, orders, invariants; methods are held to the stored error tables.

Peers are in the report's rows and not in the stored tables: their numbers follow the releases of other packages, and a
number that moved there is no regression here.
"""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.integrators.registry import METHODS, method
from phasebench.reference import tables

KEYS = ["method", "h"]
TRAJECTORY = ("global_error", "refinement_difference")
INVARIANTS = ("energy_max", "energy_max_early", "angular-momentum_max")
#: Where trajectories part, round-off decides what happens late: only the early energy error can be held.
CHAOTIC = ("energy_max_early",)
#: Schemes IV and V choose between roots; where two are equally near, round-off decides which.
CHOICE = 0.5


def cells(quick: bool = False):
    """The sweep."""
    return sweep.cells(quick)


def _regressed(scene) -> tuple[str, ...]:
    return (*TRAJECTORY, *INVARIANTS) if scene.regular else CHAOTIC


def _table(rows, scene) -> pd.DataFrame:
    """The rows of methods, with the columns that are stored."""
    frame = pd.DataFrame([r for r in rows if r.get("kind", OURS) == OURS])
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


def regressions(rows, stored: pd.DataFrame, scene) -> pd.DataFrame:
    """The numbers of measured rows that left their bands about the stored ones, with the ratio of the two."""
    measured = _table(rows, scene)
    stored = stored[stored["method"].isin(measured["method"]) & stored["h"].isin(measured["h"])]
    found = _violations(measured, stored.reset_index(drop=True), scene)
    numbers = [pd.to_numeric(found[c], errors="coerce") for c in ("measured", "stored")]
    return found.assign(ratio=numbers[0] / numbers[1])


def recorded(rows, stored: pd.DataFrame | None, scene) -> pd.DataFrame:
    """The table to be stored: the measured rows in place of the old ones of the same methods."""
    measured = _table(rows, scene)
    if stored is None:
        return measured
    kept = stored[~stored["method"].isin(measured["method"])]
    known = {method(id, **dict(parameters)).label for id, parameters in sweep.variants()}
    kept = kept[kept["method"].isin(known)]
    return pd.concat([kept, measured]).sort_values(KEYS).reset_index(drop=True)


def _record(rows, scene, notes: list[str]) -> None:
    bands = {"relative": scene.relative, "absolute": scene.absolute, "trajectory": scene.trajectory}
    about = tables.provenance(scene.made(), scene=scene.id, **bands)
    try:
        old = tables.read(scene.id)[0]
    except (FileNotFoundError, tables.CorruptTable):
        old = None
    new = recorded(rows, old, scene)
    notes.append(f"{scene.id}: {_shown(tables.difference(old, new, KEYS))}")
    tables.write(scene.id, new, about)


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.id)
def bench_scene(scene, measured, quick, update, notes):
    """A measured number that left its band about the stored one fails, with the row, both numbers and their ratio."""
    rows = [r for r in measured("rows") if r["scene"] == scene.id and r.get("kind", OURS) == OURS]
    if not rows:
        pytest.skip("no row of a method on this scene was measured")
    if update and not quick:
        _record(rows, scene, notes)
        return
    found = regressions(rows, tables.read(scene.id)[0], scene)
    assert found.empty, (
        f"{len(found)} numbers of {scene.id} left their bands (re-record with --update-tables if that is right):\n"
        + found.to_string(index=False, float_format=lambda x: f"{x:.6e}")
    )
