"""Measure every method and peer on every scene, and compare the methods' errors with the stored error tables.

A scene is a problem, a time span and a list of steps.  Peers, integrators of other packages, have rows in the report
but not in the stored tables: their numbers change with releases of their packages, which is no regression here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pandas as pd
import pytest

from phasebench.benchmarks.ladder import sweep
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.scenes import SCENES, Scene
from phasebench.benchmarks.store import compare, error_tables
from phasebench.benchmarks.store.cells import Cell
from phasebench.integrators.registry import METHODS, method

KEYS = ["method", "h"]
TRAJECTORY = ("global_error", "refinement_difference")
INVARIANTS = ("energy_max", "energy_max_early", "angular-momentum_max")
#: On chaotic scenes round-off decides late errors: only the early energy error is compared.
CHAOTIC = ("energy_max_early",)
#: Relative band for trajectories of methods that choose between roots, where round-off may decide the choice.
CHOICE = 0.5
#: When a table is recorded anew, smaller changes are not listed.
LAST_DIGITS = compare.Band(5e-5, 0.0)


def cells(quick: bool = False) -> list[Cell]:
    """The measurements of every method and peer on every scene."""
    return sweep.cells(quick)


def _regressions(scene: Scene) -> tuple[str, ...]:
    return (*TRAJECTORY, *INVARIANTS) if scene.regular else CHAOTIC


def _table(rows: list[dict], scene: Scene) -> pd.DataFrame:
    frame = pd.DataFrame([r for r in rows if r.get("kind", OURS) == OURS])
    status = ["status"] if scene.regular else []
    uncertain = ["reference_uncertainty"] if scene.regular else []
    columns = [*KEYS, *status, *(c for c in (*_regressions(scene), *uncertain) if c in frame.columns)]
    return frame[columns].sort_values(KEYS).reset_index(drop=True)


def _bands(scene: Scene, columns: Iterable[str], chooses: bool) -> dict[str, compare.Band]:
    """Column -> band about the stored numbers; ``chooses`` for methods that choose between roots in each step."""
    return {"status": compare.EXACT} | {
        c: compare.Band(
            CHOICE if chooses and c in TRAJECTORY else scene.relative,
            scene.trajectory if c in TRAJECTORY else scene.absolute,
        )
        for c in columns
        if c in _regressions(scene)
    }


def regressions(rows: list[dict], stored: pd.DataFrame, scene: Scene) -> list[compare.Difference]:
    """The numbers of a scene outside their bands about the stored ones, and rows that are missing on either side."""
    measured = _table(rows, scene)
    stored = stored[stored["method"].isin(measured["method"]) & stored["h"].isin(measured["h"])]
    choosing = [m.id for m in METHODS if m.family in ("schemes_iv_v", "equip")]
    found = []
    for chooses in (False, True):
        here = [t[t["method"].isin(choosing) == chooses].to_dict("records") for t in (measured, stored)]
        found += compare.differences(compare.match(*here, KEYS), _bands(scene, measured.columns, chooses))
    return found


def record(rows: list[dict], stored: pd.DataFrame | None, scene: Scene) -> pd.DataFrame:
    """A scene's new error table: measured rows replace the stored ones of their methods; methods that are gone go."""
    measured = _table(rows, scene)
    if stored is None:
        return measured
    kept = stored[~stored["method"].isin(measured["method"])]
    known = {method(id, **dict(parameters)).label for id, parameters in variants()}
    kept = kept[kept["method"].isin(known)]
    return pd.concat([kept, measured]).sort_values(KEYS).reset_index(drop=True)


def _update(rows: list[dict], scene: Scene, notes: list[str]) -> None:
    bands = {"relative": scene.relative, "absolute": scene.absolute, "trajectory": scene.trajectory}
    about = error_tables.provenance(problem_of(scene.problem), scene=scene.id, **bands)
    try:
        old = error_tables.load(scene.id)[0]
    except (FileNotFoundError, error_tables.CorruptTable):
        old = None
    new = record(rows, old, scene)
    notes.append(f"{scene.id}: {changes(old, new)}")
    error_tables.save(scene.id, new, about)


def changes(old: pd.DataFrame | None, new: pd.DataFrame) -> str:
    """The changes from an old error table, which may be None, to a new one: a line for each, small ones counted."""
    if old is None:
        return f"new table of {len(new)} rows"
    lines = [f"- column {c}" for c in old if c not in new] + [f"+ column {c}" for c in new if c not in old]
    pairs = compare.match(new.to_dict("records"), old.to_dict("records"), KEYS)
    columns = [c for c in old if c in new and c not in KEYS]
    every, large = (compare.differences(pairs, dict.fromkeys(columns, b)) for b in (compare.EXACT, LAST_DIGITS))
    left = len(every) - len(large)
    return "\n".join(lines + [f"  {d}" for d in large] + ([f"  and {left} numbers moved less"] if left else []))


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.id)
def bench_scene(
    scene: Any, measured_rows: Callable[[str], list[dict]], quick: bool, update: bool, notes: list[str]
) -> None:
    """Measured errors are within their bands about the stored ones; --update-tables stores them instead."""
    rows = [r for r in measured_rows("rows") if r["scene"] == scene.id and r.get("kind", OURS) == OURS]
    if not rows:
        pytest.skip("no row of a method on this scene was measured")
    if update and not quick:
        _update(rows, scene, notes)
        return
    try:
        stored = error_tables.load(scene.id)[0]
    except FileNotFoundError:
        pytest.fail(f"no errors of {scene.id} are stored; pytest benchmarks --update-tables stores them")
    found = regressions(rows, stored, scene)
    assert not found, (
        f"{len(found)} numbers of {scene.id} left their bands (re-record with --update-tables if that is right):\n"
        + "\n".join(map(str, found))
    )
