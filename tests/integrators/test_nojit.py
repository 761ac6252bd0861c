"""Compiled kernels and the same sources on plain NumPy reach the same end states."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import by_label
from phasebench.integrators.compile.codegen import compiled
from support import plain

ALL = by_label(plain.METHODS)
ROUND_OFF = 1e-12


@pytest.fixture(scope="module")
def here():
    """{method: {system: [status, end state]}} of runs compiled in this process."""
    assert compiled()
    return plain.end_states()


@pytest.fixture(scope="module")
def there(uncompiled):
    """{method: {system: [status, end state]}} of the same runs without compilation."""
    return uncompiled("support/plain.py")


def read(row):
    """The end state, an array, from a row [status, numbers in hexadecimal] of `support.plain.end_states`."""
    return np.array([float.fromhex(x) for x in row[1]])


@pytest.mark.parametrize("label", ALL)
def test_compiled_and_uncompiled_runs_agree(here, there, label):
    assert set(here[label]) == set(there[label]) == set(plain.systems_for(ALL[label]))
    for name, row in here[label].items():
        assert row[0] == there[label][name][0] == "ok", name
        assert np.abs(read(row) - read(there[label][name])).max() < ROUND_OFF, name


def test_control_different_methods_reach_different_states(here):
    a, b = (read(here[x]["henon-heiles"]) for x in ("implicit-midpoint", "scheme-i(lam=1/3)"))
    assert np.abs(a - b).max() > 1e6 * ROUND_OFF


def test_only_other_numbers_of_nodes_are_left_out():
    left = [
        label for label, m in ALL.items() if plain.systems_for(m) != [n for n in plain.NAMES if plain.runs_on(m, n)]
    ]
    assert left == [
        *(f"gauss-{s}" for s in (1, *range(3, 9))),
        *(f"hbvm-{k}" for k in ("2-1", "6-3", "8-4")),
        *(f"gauss-equip-{s}" for s in (3, 4)),
    ]
    assert all(plain.NAMES[0] in plain.systems_for(ALL[label]) for label in left)
    assert all(plain.systems_for(ALL[id]) == [*plain.NAMES] for id in plain.FEWEST.values())
