"""The same sources on plain NumPy reach the same end states as compiled ones."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import by_label, runs_on
from phasebench.integrators.engine.codegen import compiled
from support import plain

ALL = by_label(plain.METHODS)
ROUND_OFF = 1e-12


@pytest.fixture(scope="module")
def here():
    assert compiled()
    return plain.end_states()


@pytest.fixture(scope="module")
def there(uncompiled):
    return uncompiled("support/plain.py")


def read(row):
    return np.array([float.fromhex(x) for x in row[1]])


@pytest.mark.parametrize("label", ALL)
def test_compiled_and_plain_agree(here, there, label):
    assert set(here[label]) == set(there[label]) == {n for n in plain.NAMES if runs_on(ALL[label], n)}
    for name, row in here[label].items():
        assert row[0] == there[label][name][0] == "ok", name
        assert np.abs(read(row) - read(there[label][name])).max() < ROUND_OFF, name


def test_control_different_methods_reach_different_states(here):
    a, b = (read(here[x]["henon-heiles"]) for x in ("implicit-midpoint", "scheme-i(lam=1/3)"))
    assert np.abs(a - b).max() > 1e6 * ROUND_OFF
