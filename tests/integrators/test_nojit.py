"""The end states of all methods are the stored ones, and those of compiled kernels equal those of plain NumPy."""

from __future__ import annotations

from dataclasses import replace

import pytest

from phasebench.benchmarks.measure.multiprecision import leaves, replace_at
from phasebench.integrators.compile.codegen import compiled
from support import plain


@pytest.fixture(scope="module")
def there(uncompiled):
    """Method's label -> its ends without compilation."""
    return uncompiled("support/plain.py")


def test_end_states_are_the_stored_ones(there):
    """`python tests/support/plain.py --record` stores them anew and shows the difference."""
    known = plain.stored()
    assert set(there) == set(known) == set(plain.METHODS)
    off = {label: said for label, ends in there.items() if (said := plain.apart(ends, known[label]))}
    assert not off
    failed = {label for label, ends in known.items() if not ends or {status for status, _ in ends.values()} != {"ok"}}
    assert not failed


@pytest.mark.parametrize("label", plain.KINDS)
def test_compiled_and_uncompiled_runs_agree(there, label):
    """On `plain.NAMES`, where it runs there: other tests compile the same kernels."""
    assert compiled()
    names = [name for name in there[label] if name in plain.NAMES] or [*there[label]][:1]
    assert plain.apart(plain.ends(plain.KINDS[label], names), {name: there[label][name] for name in names}) == []


@pytest.mark.parametrize("label", ["kahan-li-8", "scheme-v-yoshida-4"])
def test_control_another_coefficient_ends_elsewhere(label):
    m = plain.METHODS[label]
    path, x = next(leaves(m.data))
    assert plain.apart(plain.ends(replace(m, data=replace_at(m.data, path, x * (1 + 1e-9)))), plain.stored()[label])
