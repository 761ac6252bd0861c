"""The pytest plugin: ``phasebench_claims(step, order=4, symplectic=True)`` in anyone's tests.

    def test_my_step(phasebench_claims):
        phasebench_claims(step, order=2, symplectic=True, requires="separable")

Every pytest where phasebench is installed loads this module; it therefore imports nothing of phasebench before a test
uses the fixture.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from phasebench.benchmarks.certificate.result import Certificate
    from phasebench.integrators.record import Method
    from phasebench.reference.peers import Peer


def claims_hold(
    step: str | Path | Callable[..., Any] | Mapping[str, Any] | Method | Peer,
    *,
    requires: str | tuple[str, ...] = (),
    seed: int = 0,
    **claims: Any,
) -> Certificate:
    """Fail the test that calls it unless every claim was seen to hold; return the certificate.

    Only what is claimed is measured, in some ten thousand calls; `phasebench validate` makes up to a hundred thousand.

    Parameters
    ----------
    step : a function ``step(system, q, p, h) -> (q, p)``, or another target of `phasebench.validate`
    requires : traits that a system must have, such as "separable"
    seed : of the random states at which the step is measured
    claims : what the step claims, as in ``order=4, symplectic=True``
    """
    from phasebench.benchmarks.certificate.certificate import certify

    requires = (requires,) if isinstance(requires, str) else tuple(requires)
    found = certify(step, claims, requires, seed, alone=True)
    if found.verdict != "pass":
        pytest.fail(found.summary(), pytrace=False)
    return found


@pytest.fixture(name="phasebench_claims")
def _phasebench_claims() -> Callable[..., Certificate]:
    """A function (step, **claims) that fails the test unless every claim of the step was seen to hold."""
    return claims_hold
