"""A made-up table of coefficients, and the precision in which tests read tables."""

from __future__ import annotations

from collections.abc import Iterator

import mpmath
import pytest

from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.table import Table

#: Leapfrog with a wrong digit in its kick.
MADE_UP = Table("made-up", "splitting", (2,), "made up", (), a=("1",), b=("0.50000001",))


@pytest.fixture(autouse=True)
def full_precision() -> Iterator[None]:
    """Compute with `DIGITS` digits in each test of a file that imports this fixture."""
    with mpmath.workdps(DIGITS):
        yield
