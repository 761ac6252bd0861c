"""The systems on which all methods of the registry are tested, and the parameter values with which they are tested."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache
from itertools import product
from typing import TYPE_CHECKING

import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS
from phasebench.integrators.systems.constrained import ConstrainedHamiltonian
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.parts import SplitHamiltonian
from phasebench.integrators.systems.rigid import RigidBody

if TYPE_CHECKING:
    from phasebench.integrators.keywords import Value
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Parameter name -> the values to test; other parameters keep their default.
VALUES = {
    "lam": (Fraction(-1), Fraction(1, 3), Fraction(1, 2), Fraction(3, 2)),
    "order": (1, 2, 3, 4),
}
#: Values of the parameter ``order`` at which formulae stay short only for a few polynomial H.
HIGH = (5, 6)


def _build_if_valid(record: Method, values: dict) -> list[Method]:
    try:
        return [record(**values)]
    except InvalidInput:
        return []


def variants(methods: Iterable[Method] = METHODS, **values: Sequence[Value]) -> list[Method]:
    """Return every method at every combination of tested parameter values that it accepts.

    The values are those of `VALUES`; ``values``, name -> values, adds or replaces entries.  Other parameters keep their
    default, and so do all parameters of a method of order above `LOW_ORDER`, unless its order is a parameter.
    """
    values = VALUES | values
    members = []
    for record in methods:
        if record.order > LOW_ORDER and "order" not in record.parameters:
            members.append(record)
            continue
        names = list(record.parameters)
        grids = [values.get(n, (record.parameters[n],)) for n in names]
        accepted = [
            m for point in product(*grids) for m in _build_if_valid(record, dict(zip(names, point, strict=True)))
        ]
        assert accepted or not set(values) <= set(VALUES), f"{record.id} accepts none of the tested parameters"
        members += accepted
    return members


def high_order_variants() -> list[Method]:
    """Return the methods that have their order as a parameter, each at every high order in `HIGH`."""
    return variants([m for m in METHODS if "order" in m.parameters], order=HIGH)


def by_label(methods: Sequence[Method]) -> dict[str, Method]:
    """Return the dict label (id with parameters) -> method of some methods; assert that the labels are unique."""
    table = {m.label: m for m in methods}
    assert len(table) == len(methods)
    return table


def tao() -> Hamiltonian:
    """Make the non-separable test system H = (q^2 + 1)(p^2 + 1)/2: M. Tao, Phys. Rev. E 94 (2016) 043303."""
    return Hamiltonian(q="q", p="p", H="(q**2 + 1)*(p**2 + 1)/2")


def coupled_double_well() -> Hamiltonian:
    """Make a double well with velocity-dependent coupling, d = 2, without symmetry under q <-> p or 1 <-> 2."""
    return Hamiltonian(
        q="q1 q2", p="p1 p2", H="(p1**2 + p2**2)/2 + q1*p1*p2/4 + (q1**2 - 1)**2/4 + q2**2/2 + q1**2*q2*p2/3"
    )


def two_frequencies() -> Hamiltonian:
    """Make a Henon-Heiles system with the frequencies 1 and 3/2, to test methods with filter functions.

    With equal frequencies a filter would be a multiple of the identity, and every filtered method symplectic.
    """
    H = "(p1**2 + p2**2)/2 + (q1**2 + 9*q2**2/4)/2 + q1**2*q2 - q2**3/3"
    return Hamiltonian(q="q1 q2", p="p1 p2", H=H, frequencies=[1, sp.Rational(3, 2)])


def relativistic_particle() -> Hamiltonian:
    """Make a relativistic charged particle in a magnetic mirror with an electric potential; m = 1/2, c = 2."""
    A = ("-y*(1 + z**2/4)/2", "x*(1 + z**2/4)/2", "0")
    square = " + ".join(f"(p{k} - ({a}))**2" for k, a in zip("xyz", A, strict=True))
    return Hamiltonian(q="x y z", p="px py pz", H=f"2*sqrt(1 + {square}) + x**2*y/4 - y*z/3 + z**4/8")


def on_sphere() -> ConstrainedHamiltonian:
    """Make a particle on the unit sphere in an anharmonic potential: d = 3, one constraint."""
    H = "(u**2 + v**2 + w**2)/2 + z + x**2*y/2 - z**2*x/3"
    return ConstrainedHamiltonian(q="x y z", p="u v w", H=H, constraints=["x**2 + y**2 + z**2 = 1"])


def rods() -> ConstrainedHamiltonian:
    """Make a double pendulum in Cartesian coordinates: masses 1 and 2 on two rigid rods, d = 4, two constraints.

    A cubic term of the potential couples the masses.
    """
    H = "(u1**2 + v1**2)/2 + (u2**2 + v2**2)/4 + y1 + 2*y2 + x2**2*y1/4"
    rods = ["x1**2 + y1**2 = 1", "(x2 - x1)**2 + (y2 - y1)**2 = 1"]
    return ConstrainedHamiltonian(q="x1 y1 x2 y2", p="u1 v1 u2 v2", H=H, constraints=rods)


def on_ellipsoid() -> ConstrainedHamiltonian:
    """Make a system with a non-separable H on an ellipsoid: d = 3, one constraint."""
    H = "(u**2 + v**2)/2*(1 + z**2/4) + w**2/2 + x*v/4 + u*w*y/3 + x**2*y/2 + z"
    return ConstrainedHamiltonian(q="x y z", p="u v w", H=H, constraints=["x**2 + 2*y**2 + 3*z**2 = 1"])


def asymmetric_top() -> RigidBody:
    """Make a rigid body with three different moments of inertia in an anisotropic potential of its attitude."""
    return RigidBody(moments=(1, "3/2", 2), V="r33 + r13/2 - r12*r31/3")


def nearly_symmetric_top() -> RigidBody:
    """Make a heavy top with the moments of inertia 1/2, 1, 11/10: the last two are nearly equal.

    The axis of the smallest moment passes through the centre of mass.
    """
    return RigidBody(moments=("1/2", 1, "11/10"), V="r31")


def geodesic() -> SplitHamiltonian:
    """Make the geodesics near a Schwarzschild black hole off the equatorial plane, H a sum of four solvable parts."""
    parts = ["u**2/2", "-u**2/r", "v**2/(2*r**2)", "-1/(2 - 4/r) + 8/(r**2*sin(f)**2)"]
    return SplitHamiltonian(q="r f", p="u v", parts=parts)


def many_parts() -> SplitHamiltonian:
    """Make a polynomial H, d = 2, of five parts with exact flows: shears, monomials, a square (`systems.parts`)."""
    parts = [
        "(q1**2 + 2*p1**2)/2",
        "q2*p2*(1 + q1**2)/5",
        "p2**2/2 + p1**3/9",
        "q1*q2**2/3 + q2**4/4 + q2**2/2",
        "q1**2*p1*q2/7",
    ]
    return SplitHamiltonian(q="q1 q2", p="p1 p2", parts=parts)


def _turned(body: RigidBody, momentum: tuple[float, ...]) -> tuple[RigidBody, tuple[float, ...], tuple[float, ...]]:
    return body, *(tuple(map(float, x)) for x in body.start(attitude=(0.8, 0.48, 0.0, -0.36), momentum=momentum))


#: Name -> a cached function that returns (system, q, p).
SYSTEMS = {
    "pendulum": cache(lambda: _of("pendulum:swinging")),
    "henon-heiles": cache(lambda: _of("henon-heiles:chaotic")),
    "perturbed-kepler": cache(lambda: _of("perturbed-kepler")),
    "lotka-volterra": cache(lambda: _of("lotka-volterra")),
    "tao": cache(lambda: (tao(), (0.3,), (-0.7,))),
    "two-frequencies": cache(lambda: (two_frequencies(), (0.1, -0.2), (0.3, 0.15))),
    "coupled": cache(lambda: (coupled_double_well(), (0.4, -0.6), (0.5, 0.3))),
    "charged-particle": cache(lambda: _of("charged-particle")),
    "magnetic-mirror": cache(lambda: _of("magnetic-mirror")),
    "on-sphere": cache(lambda: (on_sphere(), (1.0, 0.0, 0.0), (0.0, 0.5, -0.75))),
    "rods": cache(lambda: (rods(), (1.0, 0.0, 1.0, 1.0), (0.0, 0.5, -0.75, 1.0))),
    "on-ellipsoid": cache(lambda: (on_ellipsoid(), (1.0, 0.0, 0.0), (0.0, 0.5, -0.75))),
    "asymmetric-top": cache(lambda: _turned(asymmetric_top(), (0.4, -0.9, 0.6))),
    "nearly-symmetric-top": cache(lambda: _turned(nearly_symmetric_top(), (0.5, 0.6, -0.7))),
    "geodesic": cache(lambda: (geodesic(), (10.0, 1.3), (0.1, 2.5))),
    "many-parts": cache(lambda: (many_parts(), (0.4, -0.6), (0.5, 0.3))),
    "relativistic-particle": cache(lambda: (relativistic_particle(), (0.3, -0.5, 0.4), (0.4, 0.6, -0.3))),
}
#: Systems on which formulae of high order stay short; enough for long compositions that solve an equation per substep.
SHORT = ("henon-heiles", "tao")
#: Systems that suffice for a property of a single step, and for the order of a method of high order.
FEW = ("pendulum", "henon-heiles", "tao")
#: Methods of higher order are tested at one value of lambda, on a few systems.
LOW_ORDER = 4
NON_SEPARABLE = ("tao", "coupled")
#: Systems of charged particles, for the methods that require one, and methods measured there besides, as controls.
MAGNETIC = ("charged-particle", "magnetic-mirror", "relativistic-particle")
CONTROLS = ("explicit-euler", "rk4", "implicit-midpoint", "gauss-4")
#: Systems with constraints, for the methods that require them.
CONSTRAINED = ("on-sphere", "rods", "on-ellipsoid")
#: Rigid bodies, for the methods that require one.
RIGID = ("asymmetric-top", "nearly-symmetric-top")
#: Systems of parts with exact flows, for the methods that require some.
PARTS = ("geodesic", "many-parts")
#: Trait -> the systems on which methods are tested that require it; no other method is tested on them.
BY_TRAIT = {"magnetic": MAGNETIC, "constrained": CONSTRAINED, "rigid body": RIGID, "parts": PARTS}
#: Methods superconverge at turning points by symmetry, so orders are measured from this time of the orbit on.
LATER = 0.4


def _of(name: str) -> tuple[PartitionedSystem, tuple[float, ...], tuple[float, ...]]:
    whole = problem(name)
    return whole.system, whole.q0, whole.p0


def as_problem(name: str) -> Problem:
    """Make a `Problem` of a test system, a key of `SYSTEMS`, with its initial state as the only orbit."""
    system, q, p = SYSTEMS[name]()
    return Problem(name, name, "", system, (Orbit("start", tuple(map(float, q)), tuple(map(float, p))),))


def runs_on(method: Method, name: str) -> bool:
    """True if a test system, ``name`` in `SYSTEMS`, has all traits that the method requires."""
    return method.lacks(SYSTEMS[name]()[0]) is None


def systems(method: Method, few: bool | None = None) -> list[str]:
    """Return the names of the test systems, keys of `SYSTEMS`, on which a method is tested.

    ``few`` restricts them to those in `FEW`, if the method can integrate any of these, and does not require a linear
    fast part; by default it is True for a method of order above `LOW_ORDER`.  A method that requires a trait in
    `BY_TRAIT` is tested on the systems named there.  A method whose formulae are too long, or steps too slow, on most
    systems is tested on those in `SHORT` only.
    """
    if method.parameters.get("order", 0) in HIGH or (method.family == "schemes_iv_v" and method.order > LOW_ORDER):
        return [n for n in SHORT if runs_on(method, n)]
    for trait, special in BY_TRAIT.items():
        if trait in method.requires:
            return [n for n in special if runs_on(method, n)]
    few = method.order > LOW_ORDER if few is None else few
    fast, special = "linear fast part" in method.requires, {n for names in BY_TRAIT.values() for n in names}
    names = [n for n in SYSTEMS if n not in special and runs_on(method, n) and (fast or n != "two-frequencies")]
    return [n for n in names if n in FEW] or names if few and not fast else names


def magnetic(method: Method) -> list[str]:
    """Return the names of the magnetic systems on which a method's preservation of phase-space volume is measured.

    The list is empty for a method that neither requires a magnetic system nor is in `CONTROLS`, general methods that
    are measured there for comparison.
    """
    measured = "magnetic" in method.requires or method.id in CONTROLS
    return [n for n in MAGNETIC if runs_on(method, n)] if measured else []


def expected_order(method: Method, name: str) -> int:
    """Return the order of convergence that a method should show on a test system, a key of `SYSTEMS`.

    It is the declared order, or 2 for a partitioned averaged vector field (or Itoh-Abe) method of two blocks on a
    separable H = T(p) + V(q): the result does not depend on the order of the blocks there, so that it is symmetric.
    """
    system = SYSTEMS[name]()[0]
    blocks = {"pavf": 2, "pavf-adjoint": 2, "itoh-abe": 2 * system.d}.get(method.id)
    return 2 if blocks == 2 and system.separable else method.order


def canonical(name: str) -> bool:
    """True if a test system, a key of `SYSTEMS`, is canonical, so that step maps on it can be symplectic."""
    return SYSTEMS[name]()[0].canonical


def keeps_a_form(name: str) -> bool:
    """True if step maps on a test system can be symplectic, in phase space or on the manifold of its constraints.

    ``name`` is a key of `SYSTEMS`.
    """
    system = SYSTEMS[name]()[0]
    return system.canonical or system.constrained
