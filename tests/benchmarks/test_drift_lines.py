"""The parts of a drift estimate: finding, refining and removing slow oscillations."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import drift as module

N = 400
X = np.arange(N) / N - 0.5
HANN = np.hanning(N + 2)[1:-1]


def wave(periods: float, phase: float = 0.3) -> np.ndarray:
    """A cosine with this number of periods in the full time."""
    return np.cos(2 * np.pi * periods * X + phase)


@pytest.mark.parametrize("periods", [5.1, 17.37, 60.8])
def test_frequency_is_found_and_refined_to_round_off(periods):
    found = module._line(wave(periods) * HANN)
    assert abs(found - periods) < 0.01
    started = np.array([periods + 0.05])
    assert abs(module._refine(X, wave(periods), HANN, started)[0] - periods) < 1e-7, "Newton's method, three steps"


@pytest.mark.parametrize("start", [-0.9, 0.9])
def test_refinement_moves_a_frequency_by_at_most_one(start):
    """On noise, where a Newton step could move a frequency (in periods per span) by any amount."""
    moved = []
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal(N)
        moved.append(module._refine(X, noise, HANN, np.array([20 + start]))[0] - 20 - start)
    assert max(map(abs, moved)) <= 1 + 1e-12
    assert min(moved) < -0.3
    assert max(moved) > 0.3


def test_alternating_error_has_no_drift():
    t = np.arange(400.0)
    found = module.drift(t, np.where(t % 2, 1e-3, -1e-3))
    assert found.low <= 0 <= found.high
    assert module._line(wave(N / 2 - 1) * HANN) is None, "too fast to be told from its mirror image"
