"""Results do not depend on the units of p: with p and H scaled by a power of two, q agrees to round-off.

Run without compilation; `test_nojit` compares compiled with uncompiled states. A stopping rule in a joint norm of q and
p would miss errors of momenta far smaller than the coordinates. Gonzalez' discrete gradient, projections and Tao's
bond of two copies use the Euclidean norm of (q, p) by definition and depend on units: the controls.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS

POWERS = (-24, 24)
Q0, P0, STEPS = 2.0, 0.3, 40
EUCLIDEAN = {"discrete_gradient", "projection", "extended"}


def pendulum(power: int) -> Hamiltonian:
    """H = 2^k ((p / 2^k)^2 + 1 - cos q), whose mass is not 1 in any units, as unit mass has kernels of its own."""
    return Hamiltonian(q="q", p="p", H=f"p**2*{2.0**-power!r} + {2.0**power!r}*(1 - cos(q))")


SYSTEMS = {power: pendulum(power) for power in (0, *POWERS)}


def scaled_distances(method) -> dict[int, float]:
    """Distance of the runs in other units from the one in units of 1; NaN if a run fails, which no test accepts."""
    own = integrate(SYSTEMS[0], method, h=0.1, steps=STEPS, q0=[Q0], p0=[P0])
    return {power: distance(own, method, power) if own.status == "ok" else np.nan for power in POWERS}


def distance(own, method, power: int) -> float:
    """Distance in q of a run with p and H in units of 2^power from the run ``own`` in units of 1."""
    try:
        other = integrate(SYSTEMS[power], method, h=0.1, steps=STEPS, q0=[Q0], p0=[P0 * 2.0**power])
    except ValueError:  # of the sine of infinity, uncompiled
        return np.inf
    if other.status != "ok":
        return np.inf
    return float(max(np.abs(other.q - own.q).max(), np.abs(other.p / 2.0**power - own.p).max()))


def one_of_each() -> list[Method]:
    """For each family and kind of tableau the first method and the one of highest order."""
    kinds: dict[tuple, list[Method]] = {}
    for m in METHODS:
        if not m.lacks(SYSTEMS[0]):
            kind = m.data[0] if m.data and isinstance(m.data[0], str) else None
            kinds.setdefault((m.family, kind), []).append(m)
    ends = [(same[0], max(same, key=lambda m: m.order)) for same in kinds.values()]
    return [m for first, last in ends for m in ((first,) if first is last else (first, last))]


CHOSEN = one_of_each()


@pytest.fixture(scope="module")
def there(uncompiled):
    """Results that this module prints when it is run as a script without compilation."""
    return uncompiled("integrators/test_scaling.py")


@pytest.mark.parametrize("power", POWERS)
@pytest.mark.parametrize("m", CHOSEN, ids=lambda m: m.id)
def test_units_of_momenta_change_only_round_off(there, m, power):
    distance = there["moved"][m.id][str(power)]
    if m.family in EUCLIDEAN:
        assert distance > 1e-9
    else:
        assert distance < 1e-12


def tilted_pendulum(power: int) -> Hamiltonian:
    """A pendulum whose mass depends on q, with p and H in units of 2^power; not separable, not polynomial."""
    return Hamiltonian(q="q", p="p", H=f"p**2*(1 + sin(q)**2)*{2.0**-power!r}/2 - {2.0**power!r}*cos(q)")


def scaled_outcome(power: int) -> dict:
    """Status and fallbacks of cpg-1 and avf, and the distance of their ends, with momenta in units of 2^power."""
    runs = [
        integrate(tilted_pendulum(power), m, h=0.1, steps=200, q0=[1.0], p0=[0.5 * 2.0**power])
        for m in ("cpg-1", "avf")
    ]
    q, p = (float(np.abs(getattr(runs[0], x) - getattr(runs[1], x)).max()) for x in "qp")
    ends = {"status": [s.status for s in runs], "fallbacks": [s.counts["fallbacks"] for s in runs]}
    return ends | {"q": q, "p": p * 2.0**-power}


TILTED = (-32, -20, 0, 32)


@pytest.mark.parametrize("power", TILTED)
def test_cpg_1_is_avf_in_any_units(there, power):
    """Their quadratures are confirmed for q and p separately; a joint norm would ignore the momenta."""
    found = there["apart"][str(power)]
    assert found["status"] == ["ok", "ok"]
    assert found["fallbacks"] == [0, 0]
    assert found["q"] < 1e-13
    assert found["p"] < 1e-13


if __name__ == "__main__":
    result = {
        "moved": {m.id: scaled_distances(m) for m in CHOSEN},
        "apart": {power: scaled_outcome(power) for power in TILTED},
    }
    print(json.dumps({"result": result}, default=int))
