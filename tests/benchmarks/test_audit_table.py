"""Cells of the audit's table: an energy error is called round-off up to Brouwer's law and only there."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.audit import table
from phasebench.benchmarks.judge.evidence import round_off

#: A completed run; the interval of the drift selects the word.
ROW = {"measure": "energy", "status": "ok", "problem": "pendulum", "scale": 1.0, "steps": 1000, "time": 10.0}


def energy_cell(value: float, slope: float = 0.0, half: float = 1e-30) -> str:
    """The cell that the audit's table prints for an energy error with this value and slope in time, +- ``half``."""
    row = ROW | {"value": value, "slope": slope, "low": slope - half, "high": slope + half}
    return table.cell([row], "energy")


LIMIT = round_off(ROW)


@pytest.mark.parametrize(
    ("value", "slope", "half", "word"),
    [
        (0.5 * LIMIT, 0.0, 1e-30, "round-off"),
        (LIMIT, 0.0, 1e-30, "round-off"),
        (0.5 * LIMIT, 1.0, 1e-3, "round-off"),
        (1.01 * LIMIT, 0.0, 1e-30, "bounded"),
        (1e-3, 1e-9, 2e-9, "bounded"),
        (1e-3, 6e-5, 1e-9, "drifts"),
        (1e-3, 3e-5, 1e-9, "drifts"),
        (1e-3, 3e-5, 2e-5, "open"),
        (0.3, 1e-9, 2e-9, "large"),
    ],
)
def test_energy_error_is_round_off_up_to_its_law(value, slope, half, word):
    text = energy_cell(value, slope, half)
    assert text.split()[2] == word
    assert ("round-off" in text) is (value <= LIMIT)
    assert text.startswith(f"pendulum {value:.0e} ")
    assert text.endswith(f" {slope:+.0e} +- {half:.0e}")
