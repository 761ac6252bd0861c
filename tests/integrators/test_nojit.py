"""The same sources on plain NumPy reach the same end states as compiled ones."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import by_label
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
    assert set(here[label]) == set(there[label]) == set(plain.chosen(ALL[label]))
    for name, row in here[label].items():
        assert row[0] == there[label][name][0] == "ok", name
        assert np.abs(read(row) - read(there[label][name])).max() < ROUND_OFF, name


def test_control_different_methods_reach_different_states(here):
    a, b = (read(here[x]["henon-heiles"]) for x in ("implicit-midpoint", "scheme-i(lam=1/3)"))
    assert np.abs(a - b).max() > 1e6 * ROUND_OFF


def test_only_more_nodes_of_a_kind_are_left_out_and_on_the_second_system_alone():
    left = [label for label, m in ALL.items() if plain.chosen(m) != [n for n in plain.NAMES if plain.runs_on(m, n)]]
    assert left == [
        *(f"gauss-{s}" for s in (1, *range(3, 9))),
        *(f"hbvm-{k}" for k in ("2-1", "6-3", "8-4")),
        *(f"gauss-equip-{s}" for s in (3, 4)),
    ]
    assert all(plain.NAMES[0] in plain.chosen(ALL[label]) for label in left)
    assert all(plain.chosen(ALL[id]) == [*plain.NAMES] for id in plain.FEWEST.values())
