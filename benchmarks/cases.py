"""The methods and systems that the registry-wide tests run on, taken from the registry itself."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

from benchmarks.problems import problem
from integrators.errors import InvalidInput
from integrators.hamiltonian import Hamiltonian
from integrators.record import Method
from integrators.registry import METHODS

#: Values at which a parameter of that name is tested; parameters of other names keep their default.
VALUES = {
    "lam": (Fraction(-1), Fraction(1, 3), Fraction(1, 2), Fraction(3, 2)),
    "order": (1, 2, 3, 4),
}
#: Orders of a method with the parameter ``order`` for which the formulae stay short only on few polynomials.
HIGH = (5, 6)


def _accepted(record: Method, values: dict) -> list[Method]:
    try:
        return [record(**values)]
    except InvalidInput:
        return []


def variants(methods=METHODS, **values) -> list[Method]:
    """Every method at every tested value of its parameters."""
    values = VALUES | values
    found = []
    for record in methods:
        names = list(record.parameters)
        grids = [values.get(n, (record.parameters[n],)) for n in names]
        here = [m for point in product(*grids) for m in _accepted(record, dict(zip(names, point, strict=True)))]
        assert here or not set(values) <= set(VALUES), f"{record.id} accepts none of the tested parameters"
        found += here
    return found


def high_order_variants() -> list[Method]:
    """Methods with the parameter ``order`` at the orders of `HIGH`."""
    return variants([m for m in METHODS if "order" in m.parameters], order=HIGH)


def by_label(methods) -> dict[str, Method]:
    """Label -> method; the labels are unique."""
    table = {m.label: m for m in methods}
    assert len(table) == len(methods)
    return table


def tao() -> Hamiltonian:
    """H = (q^2 + 1)(p^2 + 1)/2: M. Tao, Phys. Rev. E 94 (2016) 043303."""
    return Hamiltonian(q="q", p="p", H="(q**2 + 1)*(p**2 + 1)/2")


def coupled() -> Hamiltonian:
    """A double well with velocity-dependent coupling, d = 2, without any symmetry between q and p or 1 and 2."""
    return Hamiltonian(
        q="q1 q2", p="p1 p2", H="(p1**2 + p2**2)/2 + q1*p1*p2/4 + (q1**2 - 1)**2/4 + q2**2/2 + q1**2*q2*p2/3"
    )


#: Name -> (system, q, p), where the published initial state is a turning point the state that it reaches at `LATER`.
SYSTEMS = {
    "pendulum": lambda: _of("pendulum:swinging"),
    "henon-heiles": lambda: _of("henon-heiles:chaotic"),
    "perturbed-kepler": lambda: _of("perturbed-kepler"),
    "tao": lambda: (tao(), (0.3,), (-0.7,)),
    "coupled": lambda: (coupled(), (0.4, -0.6), (0.5, 0.3)),
}
#: Where the formulae of high order stay short.
SHORT = ("henon-heiles", "tao")
#: Enough for a property of a single step.
FEW = ("pendulum", "henon-heiles", "tao")
NON_SEPARABLE = ("tao", "coupled")
#: Turning points superconverge by their symmetry: measure orders at this time of the orbit instead.
LATER = 0.4


def _of(name: str):
    made = problem(name)
    return made.system, made.q0, made.p0


def runs_on(method: Method, name: str) -> bool:
    """Whether the method has what it requires on that system."""
    return method.lacks(SYSTEMS[name]()[0]) is None
