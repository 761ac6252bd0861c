"""What a solution says it evaluated is what was called: by it methods of different kinds are compared."""

from __future__ import annotations

import pytest

from phasebench.integrators.engine.codegen import compiled
from support import counts


@pytest.fixture(scope="module")
def counted(uncompiled):
    return uncompiled("support/counts.py").get if compiled() else counts.of


@pytest.mark.parametrize("label", counts.ALL)
def test_every_evaluation_is_counted_once(counted, label):
    found = counted(label)
    assert found
    for name, (told, called) in found.items():
        assert told == called > 0, name
