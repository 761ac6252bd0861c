"""The systems on which all methods of the registry are tested, and the parameter values with which they are tested."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache
from itertools import product

import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Orbit, Problem, floats
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import Value
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS
from phasebench.integrators.systems.constrained import ConstrainedHamiltonian
from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem
from phasebench.integrators.systems.parts import SplitHamiltonian
from phasebench.integrators.systems.rigid import RigidBody

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

    The values are those of `VALUES`, of which ``values`` replaces some; other parameters, and those of a method above
    `LOW_ORDER` whose order is none of them, keep their default.
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


def relativistic_particle() -> Hamiltonian:
    """Make a relativistic charged particle in a magnetic mirror with an electric potential; m = 1/2, c = 2."""
    A = ("-y*(1 + z**2/4)/2", "x*(1 + z**2/4)/2", "0")
    square = " + ".join(f"(p{k} - ({a}))**2" for k, a in zip("xyz", A, strict=True))
    return Hamiltonian(q="x y z", p="px py pz", H=f"2*sqrt(1 + {square}) + x**2*y/4 - y*z/3 + z**4/8")


def _turned(momentum: tuple[float, ...], moments: tuple, V: str) -> tuple[RigidBody, tuple, tuple]:
    body = RigidBody(moments=moments, V=V)
    return body, *map(floats, body.start(attitude=(0.8, 0.48, 0.0, -0.36), momentum=momentum))


def _bound(q: str, p: str, H: str, *constraints: str) -> ConstrainedHamiltonian:
    return ConstrainedHamiltonian(q=q, p=p, H=H, constraints=constraints)


def _two_frequencies() -> Hamiltonian:
    H = "(p1**2 + p2**2)/2 + (q1**2 + 9*q2**2/4)/2 + q1**2*q2 - q2**3/3"
    return Hamiltonian(q="q1 q2", p="p1 p2", H=H, frequencies=[1, sp.Rational(3, 2)])


#: H of a particle on the unit sphere; of masses 1 and 2 on two rods, coupled by a cubic term; on an ellipsoid.
ON_SPHERE = "(u**2 + v**2 + w**2)/2 + z + x**2*y/2 - z**2*x/3", "x**2 + y**2 + z**2 = 1"
RODS = (
    "(u1**2 + v1**2)/2 + (u2**2 + v2**2)/4 + y1 + 2*y2 + x2**2*y1/4",
    *("x1**2 + y1**2 = 1", "(x2 - x1)**2 + (y2 - y1)**2 = 1"),
)
ON_ELLIPSOID = (
    "(u**2 + v**2)/2*(1 + z**2/4) + w**2/2 + x*v/4 + u*w*y/3 + x**2*y/2 + z",
    "x**2 + 2*y**2 + 3*z**2 = 1",
)
#: Geodesics near a Schwarzschild black hole off the equatorial plane; shears, monomials, a square (`systems.parts`).
GEODESIC = ("u**2/2", "-u**2/r", "v**2/(2*r**2)", "-1/(2 - 4/r) + 8/(r**2*sin(f)**2)")
MANY_PARTS = (
    *("(q1**2 + 2*p1**2)/2", "q2*p2*(1 + q1**2)/5", "p2**2/2 + p1**3/9"),
    *("q1*q2**2/3 + q2**4/4 + q2**2/2", "q1**2*p1*q2/7"),
)
#: Name -> a cached function that returns (system, q, p).  With equal frequencies every filtered method is symplectic.
SYSTEMS = {
    "pendulum": cache(lambda: _of("pendulum:swinging")),
    "henon-heiles": cache(lambda: _of("henon-heiles:chaotic")),
    "perturbed-kepler": cache(lambda: _of("perturbed-kepler")),
    "lotka-volterra": cache(lambda: _of("lotka-volterra")),
    "tao": cache(lambda: (tao(), (0.3,), (-0.7,))),
    "two-frequencies": cache(lambda: (_two_frequencies(), (0.1, -0.2), (0.3, 0.15))),
    "coupled": cache(lambda: (coupled_double_well(), (0.4, -0.6), (0.5, 0.3))),
    "charged-particle": cache(lambda: _of("charged-particle")),
    "magnetic-mirror": cache(lambda: _of("magnetic-mirror")),
    "on-sphere": cache(lambda: (_bound("x y z", "u v w", *ON_SPHERE), (1.0, 0.0, 0.0), (0.0, 0.5, -0.75))),
    "rods": cache(lambda: (_bound("x1 y1 x2 y2", "u1 v1 u2 v2", *RODS), (1.0, 0.0, 1.0, 1.0), (0.0, 0.5, -0.75, 1.0))),
    "on-ellipsoid": cache(lambda: (_bound("x y z", "u v w", *ON_ELLIPSOID), (1.0, 0.0, 0.0), (0.0, 0.5, -0.75))),
    "asymmetric-top": cache(lambda: _turned((0.4, -0.9, 0.6), (1, "3/2", 2), "r33 + r13/2 - r12*r31/3")),
    "nearly-symmetric-top": cache(lambda: _turned((0.5, 0.6, -0.7), ("1/2", 1, "11/10"), "r31")),
    "geodesic": cache(lambda: (SplitHamiltonian(q="r f", p="u v", parts=GEODESIC), (10.0, 1.3), (0.1, 2.5))),
    "many-parts": cache(lambda: (SplitHamiltonian(q="q1 q2", p="p1 p2", parts=MANY_PARTS), (0.4, -0.6), (0.5, 0.3))),
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
    return Problem(name, name, "", system, (Orbit("start", floats(q), floats(p)),))


def runs_on(method: Method, name: str) -> bool:
    """True if a test system, ``name`` in `SYSTEMS`, has all traits that the method requires."""
    return method.lacks(SYSTEMS[name]()[0]) is None


def systems(method: Method, few: bool | None = None) -> list[str]:
    """Return the names of the test systems, keys of `SYSTEMS`, on which a method is tested.

    Those in `BY_TRAIT` if it requires one of these traits, in `SHORT` if its formulae are long or its steps slow, and
    with ``few`` (by default above `LOW_ORDER`) in `FEW`, if it can integrate any of these.
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
    """Return the magnetic systems on which volume is measured: of a method that requires one, or is in `CONTROLS`."""
    measured = "magnetic" in method.requires or method.id in CONTROLS
    return [n for n in MAGNETIC if runs_on(method, n)] if measured else []


def expected_order(method: Method, name: str) -> int:
    """Return the order that a method should show on a test system: the declared one, or 2.

    A partitioned averaged vector field (or Itoh-Abe) method of two blocks is symmetric for H = T(p) + V(q), where the
    order of the blocks does not matter.
    """
    system = SYSTEMS[name]()[0]
    blocks = {"pavf": 2, "pavf-adjoint": 2, "itoh-abe": 2 * system.d}.get(method.id)
    return 2 if blocks == 2 and system.separable else method.order


def canonical(name: str) -> bool:
    """True if a test system, a key of `SYSTEMS`, is canonical, so that step maps on it can be symplectic."""
    return SYSTEMS[name]()[0].canonical


def keeps_a_form(name: str) -> bool:
    """True if step maps on a test system can be symplectic, in phase space or on the manifold of its constraints."""
    system = SYSTEMS[name]()[0]
    return system.canonical or system.constrained
