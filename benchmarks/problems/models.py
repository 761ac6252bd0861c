r"""LADDERS: of a scene the models from the least to the full one, each with what it says of the full one's state.

A rung is a system of its own with a map of its solution to rows of the full system's (q, p).  Where it has no formula
of its own for something (the bodies that are left out), the map gives NaN.

- The pendulum from rest at A: linear; linear with Lindstedt's frequency :math:`1 - A^2/16`; sin q to third and fifth
  order.
- The Schwarzschild term (`kepler_models`): none; Kepler's orbit turned by the mean precession; averaged with mean
  elements.
- The outer planets: one without mass about the fixed Sun, then body by body.
- The springs of Fermi, Pasta and Ulam: rigid; averaged, their adiabatic invariants frozen (`fpu_models`).
- The Klein-Gordon equation: without its nonlinear term; on fewer points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np
import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian

from . import fpu, klein_gordon, outer_solar_system, problem
from .base import Orbit, Problem

#: (the full problem, t (n,), q (n, d), p (n, d)) of a rung -> (q, p) of the full problem's, arrays (n, D).
Lift = Callable[[Problem, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def unchanged(full, t, q, p):
    """The rung's state is the full one's."""
    return q, p


@dataclass(frozen=True)
class Rung:
    """A model of a scene.

    Attributes
    ----------
    name : what it is, for a table
    make : its problem
    lift : its rows -> the full problem's
    rate : its own time to the scene's
    steps : its coarsest number of steps where not the ladder's
    """

    name: str
    make: Callable[[], Problem]
    lift: Lift = unchanged
    rate: float = 1.0
    steps: int = 0


@dataclass(frozen=True)
class Ladder:
    """A scene with its models.

    Attributes
    ----------
    id : kebab-case name
    problem, parameters : of the full problem: ``id:orbit`` and its parameters
    t_end, quantity : how far, and the name of what is wanted
    steps : the coarsest number of steps
    rungs : from the least to the full model
    about : one line for a person
    """

    id: str
    problem: str
    t_end: float
    quantity: str
    steps: int
    rungs: tuple[Rung, ...]
    about: str
    parameters: tuple[tuple[str, Any], ...] = ()


def _made(name: str, q, p, H, start, **more) -> Problem:
    return Problem(
        id=name,
        name=name,
        source="a model of this suite",
        system=Hamiltonian(q=q, p=p, H=H, **more),
        orbits=(Orbit("scene", *start),),
    )


def started(made: Problem, q, p) -> Problem:
    """A problem from another state."""
    return replace(made, orbits=(Orbit("scene", tuple(q), tuple(p)),), orbit="")


# -- the pendulum ------------------------------------------------------------------------------------------------------


def pendulum_models(amplitude: float) -> tuple[Rung, ...]:
    """Those of the pendulum from rest at ``amplitude``."""
    q, p = sp.symbols("q p", real=True)
    start = (amplitude,), (0.0,)

    def polynomial(terms: int) -> Callable[[], Problem]:
        V = sum((-1) ** (k + 1) * q ** (2 * k) / sp.factorial(2 * k) for k in range(1, terms + 1))
        return lambda: _made(f"pendulum-{terms}", [q], [p], p**2 / 2 + V, start)

    shifted = 1 - amplitude**2 / 16
    return (
        Rung("harmonic", lambda: started(problem("harmonic-oscillator"), *start)),
        Rung(
            "harmonic, Lindstedt's frequency",
            lambda: started(problem("harmonic-oscillator", omega=shifted), *start),
        ),
        Rung("sin q to q^3", polynomial(2)),
        Rung("sin q to q^5", polynomial(3)),
        Rung("pendulum", lambda: _pendulum(*start)),
    )


def _pendulum(q, p) -> Problem:
    """The registered orbit where it is that one: its states are certified."""
    swinging = problem("pendulum:swinging")
    return swinging if (swinging.q0, swinging.p0) == (q, p) else started(swinging, q, p)


# -- the Schwarzschild term --------------------------------------------------------------------------------------------


def turned(rate: float) -> Lift:
    """The plane's rows turned by ``rate`` t."""

    def lift(full, t, q, p):
        c, s = np.cos(rate * t), np.sin(rate * t)
        return tuple(np.stack([c * z[:, 0] - s * z[:, 1], s * z[:, 0] + c * z[:, 1]], axis=1) for z in (q, p))

    return lift


def mean_semi_axis(e: float, mu: float) -> float:
    r"""The mean semi-major axis :math:`L^2` of the orbit that starts at pericentre 1 - e.

    With G conserved, the averaged energy :math:`-1/(2L^2) - \mu/(3L^3G^3)` is the orbit's own (to first order in mu).
    """
    G = sqrt(1 - e**2)
    energy = -0.5 - mu / (3 * (1 - e) ** 3)
    L = 1.0
    for _ in range(50):
        f = -0.5 / L**2 - mu / (3 * (L * G) ** 3) - energy
        L -= f / (1 / L**3 + mu / (L**4 * G**3))
    return L**2


def kepler_models(e: float, mu: float) -> tuple[Rung, ...]:
    r"""Those of the Schwarzschild term :math:`-\mu/(3r^3)`, of the average :math:`-\mu/(3L^3G^3)` over an orbit.

    The perihelion turns at :math:`\partial/\partial G = \mu/(L^3G^4)`, the mean anomaly grows by
    :math:`\partial/\partial L = \mu/(L^4G^3)` faster (Delaunay's elements :math:`L = \sqrt a`,
    :math:`G = \sqrt{a(1 - e^2)}`).  In "mean precession" L is that of the start, in "averaged" the mean one.
    """
    G, a = sqrt(1 - e**2), mean_semi_axis(e, mu)
    L = sqrt(a)
    near = a * (1 - sqrt(1 - G**2 / a))
    return (
        Rung("Kepler", lambda: problem("kepler", e=e)),
        Rung("Kepler, mean precession", lambda: problem("kepler", e=e), turned(mu / G**4)),
        Rung(
            "averaged, mean elements",
            lambda: started(problem("kepler", e=e), (near, 0.0), (0.0, G / near)),
            turned(mu / (L**3 * G**4)),
            rate=1 + mu / (L * G**3),
        ),
        Rung("the term itself", lambda: problem("perturbed-kepler", e=e, mu=mu)),
    )


# -- the outer planets -------------------------------------------------------------------------------------------------

BODIES = outer_solar_system.BODIES
#: The mass, in the Sun's, of a body without mass: no double notices it.
MASSLESS = 1e-20


def bodies(names: tuple[str, ...], massless: tuple[str, ...] = ()) -> Callable[[], Problem]:
    """The problem of some of the bodies, from where the full one has them."""

    def make() -> Problem:
        axes = [f"{axis}{i}" for i in range(len(names)) for axis in "xyz"]
        q, p = sp.symbols(axes, real=True), sp.symbols([f"p{n}" for n in axes], real=True)
        m = [MASSLESS if n in massless else BODIES[n][0] for n in names]
        exact = [sp.Rational(x) for x in m]
        H = sum(x**2 / (2 * exact[i // 3]) for i, x in enumerate(p))
        for j in range(len(names)):
            for i in range(j):
                r = sp.sqrt(sum((q[3 * i + k] - q[3 * j + k]) ** 2 for k in range(3)))
                H -= sp.Rational(outer_solar_system.G) * exact[i] * exact[j] / r
        where = tuple(x for n in names for x in BODIES[n][1])
        momenta = tuple(mass * v for n, mass in zip(names, m, strict=True) for v in BODIES[n][2])
        return _made("-".join(names), q, p, H, (where, momenta))

    return make


def about_the_sun(name: str) -> Callable[[], Problem]:
    """A body without mass about the fixed Sun."""

    def make() -> Problem:
        q, p = sp.symbols("x y z", real=True), sp.symbols("u v w", real=True)
        M = sp.Rational(outer_solar_system.G) * sp.Rational(BODIES["sun"][0])
        H = sum(x**2 for x in p) / 2 - M / sp.sqrt(sum(x**2 for x in q))
        return _made(f"{name}-alone", q, p, H, BODIES[name][1:])

    return make


def of_bodies(*names: str) -> Lift:
    """Positions of these bodies among all, the Sun at rest where it is not among them; NaN for the rest."""

    def lift(full, t, q, p):
        out = np.full((2, len(t), full.system.d), np.nan)
        out[:, :, :3] = 0.0
        for k, name in enumerate(names):
            at = 3 * list(BODIES).index(name)
            out[0, :, at : at + 3], out[1, :, at : at + 3] = q[:, 3 * k : 3 * k + 3], p[:, 3 * k : 3 * k + 3]
        return out[0], out[1]

    return lift


def planet_models() -> tuple[Rung, ...]:
    """Those of Jupiter's motion: without mass, then body by body."""
    names = tuple(BODIES)
    grown = (
        Rung(
            "the Sun and Jupiter" if n == 2 else f"+ {names[n - 1].capitalize()}",
            bodies(names[:n]),
            of_bodies(*names[:n]),
        )
        for n in range(2, len(names))
    )
    alone = Rung("Jupiter without mass", about_the_sun("jupiter"), of_bodies("jupiter"))
    return alone, *grown, Rung("+ Pluto: all", lambda: problem("outer-solar-system"))


def particle_models() -> tuple[Rung, ...]:
    """Those of Saturn's motion: a test particle of the Sun, of the Sun and Jupiter, a body among three, among all."""
    three = ("sun", "jupiter", "saturn")
    return (
        Rung("test particle of the Sun", about_the_sun("saturn"), of_bodies("saturn")),
        Rung("test particle of Sun and Jupiter", bodies(three, massless=("saturn",)), of_bodies(*three)),
        Rung("three bodies", bodies(three), of_bodies(*three)),
        Rung("all six bodies", lambda: problem("outer-solar-system")),
    )


# -- stiff springs -----------------------------------------------------------------------------------------------------


def soft_chain(order: int, omega: float = fpu.PARAMETERS["omega"]) -> Problem:
    """The soft chain alone, with the terms in 1 / omega^2: none (0), of the frozen invariants (1), all (2)."""
    full = problem("fpu", omega=omega)
    m = full.system.d // 2
    q0, q1, p0 = full.system.q[:m], full.system.q[m:], full.system.p[:m]
    w = full.parameters["omega"]
    stiff = sum(w_**2 * x**2 / 2 for w_, x in zip(full.system.frequencies[m:], q1, strict=True))
    U = full.system.H - stiff - sum(x**2 / 2 for x in full.system.p)
    rigid = dict.fromkeys(q1, 0)
    H, start = sum(x**2 for x in p0) / 2 + U.subs(rigid), np.array(full.p0[:m])
    if order:
        amplitudes = [(x**2 + (y / w) ** 2) / 2 for x, y in zip(full.q0[m:], full.p0[m:], strict=True)]
        H += sum(sp.Rational(a) * sp.diff(U, x, 2).subs(rigid) / 2 for a, x in zip(amplitudes, q1, strict=True))
    if order > 1:
        H -= sum(sp.diff(U, x).subs(rigid) ** 2 for x in q1) / (2 * sp.Rational(w) ** 2)
        at = dict(zip(q0, full.q0[:m], strict=True))
        mixed = sp.Matrix([[sp.diff(U, x, y).subs(rigid).subs(at) for y in q1] for x in q0])
        start = start - np.array(mixed, float) @ np.array(full.p0[m:]) / w**2
    return _made(f"fpu-slow-{order}", q0, p0, H, (full.q0[:m], tuple(map(float, start))))


def _with_springs(full, t, q, p):
    """The springs at their frequency, undisturbed."""
    m, w = full.system.d // 2, full.parameters["omega"]
    a, b = np.array(full.q0[m:]), np.array(full.p0[m:]) / w
    c, s = np.cos(w * t)[:, None], np.sin(w * t)[:, None]
    return np.hstack([q, a * c + b * s]), np.hstack([p, w * (b * c - a * s)])


def fpu_models() -> tuple[Rung, ...]:
    r"""Those of the soft chain: rigid springs, their averaged potential, and all that is of order :math:`\omega^{-2}`.

    A spring's invariant I frozen, :math:`\langle q_1^2\rangle = I/\omega^2` adds
    :math:`\tfrac12 U_{q_1q_1}\langle q_1^2\rangle` to the slow potential.  Of the same order are what the chain does to
    the springs, :math:`-U_{q_1}^2/(2\omega^2)`, and the mean of the slow momenta at the start, which is
    :math:`p_0 - U_{q_0q_1}p_1/\omega^2`.
    """
    names = ("rigid springs", "averaged, invariants frozen", "averaged, all of order 1/omega^2")
    slow = (Rung(name, lambda k=k: soft_chain(k), _with_springs, steps=20) for k, name in enumerate(names))
    return *slow, Rung("stiff springs", lambda: problem("fpu"))


# -- waves -------------------------------------------------------------------------------------------------------------


def linear_waves() -> Problem:
    """The full problem without its nonlinear term."""
    full = problem("klein-gordon")
    N, L = full.parameters["N"], full.parameters["L"]
    q, p, H = klein_gordon.formula(N, L)
    loops = {"field": klein_gordon.field, "grad_V": klein_gordon.grad_V, "energy": klein_gordon.energy}
    a, b = klein_gordon.constants(N, L)
    H -= sp.Add(*(sp.Rational(b.numerator, b.denominator) * (q[j] ** 2 + q[N + j] ** 2) ** 2 / 4 for j in range(N)))
    system = HandHamiltonian(q=q, p=p, H=H, loops=loops, constants=(a, a * 0), degree=2)
    return replace(full, id="linear-klein-gordon", system=system)


def interpolated(full, t, q, p):
    """Rows on n points of a period on the full problem's N by the trigonometric polynomial through them."""
    N = full.parameters["N"]

    def finer(z):
        n = z.shape[1] // 2
        modes = np.fft.fft(z[:, :n] + 1j * z[:, n:], axis=1)
        wide = np.zeros((len(z), N), complex)
        wide[:, : n // 2], wide[:, N - n // 2 + 1 :] = modes[:, : n // 2], modes[:, n // 2 + 1 :]
        wide[:, n // 2] = wide[:, N - n // 2] = modes[:, n // 2] / 2
        # the values are scaled by the root of the distance of points
        field = np.fft.ifft(wide, axis=1) * sqrt(N / n)
        return np.hstack([field.real, field.imag])

    return finer(q), finer(p)


def _lattice(N: int) -> Rung:
    return Rung(f"{N} points", lambda: problem("klein-gordon", N=N), interpolated)


FULL_WAVES = Rung("Klein-Gordon, 64 points", lambda: problem("klein-gordon"))

# -- the scenes --------------------------------------------------------------------------------------------------------

WEAK = (("e", 0.2), ("mu", 1e-6))
LADDERS: tuple[Ladder, ...] = (
    *(
        Ladder(
            f"pendulum-{A:g}",
            "pendulum:swinging",
            10.0,
            "end-state",
            5,
            pendulum_models(A),
            f"from rest at {A:g}, t = 10",
        )
        for A in (0.1, 0.5, 2.0)
    ),
    Ladder(
        "kepler-strong",
        "perturbed-kepler",
        10.0,
        "end-state",
        40,
        kepler_models(0.6, 0.0075),
        "e = 0.6, mu = 0.0075, the state at t = 10",
    ),
    Ladder(
        "kepler-strong-perihelion",
        "perturbed-kepler",
        1000.0,
        "perihelion",
        4000,
        kepler_models(0.6, 0.0075),
        "the perihelion at t = 1000",
    ),
    Ladder(
        "kepler-weak-perihelion",
        "perturbed-kepler",
        1000.0,
        "perihelion",
        2000,
        kepler_models(0.2, 1e-6),
        "e = 0.2, mu = 1e-6, the perihelion at t = 1000",
        WEAK,
    ),
    Ladder("jupiter-14-years", "outer-solar-system", 5000.0, "jupiter-longitude", 10, planet_models(), "its longitude"),
    Ladder(
        "jupiter-1400-years",
        "outer-solar-system",
        500_000.0,
        "jupiter-longitude",
        1000,
        planet_models(),
        "its longitude",
    ),
    Ladder(
        "saturn-140-years", "outer-solar-system", 50_000.0, "saturn-longitude", 100, particle_models(), "its longitude"
    ),
    Ladder("fpu-soft-chain", "fpu", 20.0, "slow-positions", 500, fpu_models(), "the soft positions at t = 20"),
    Ladder(
        "klein-gordon-linear",
        "klein-gordon",
        10.0,
        "end-state",
        20,
        (Rung("linear waves", linear_waves), FULL_WAVES),
        "two packets at t = 10",
    ),
    Ladder(
        "klein-gordon-points",
        "klein-gordon",
        10.0,
        "end-state",
        20,
        (_lattice(16), _lattice(32), _lattice(48), FULL_WAVES),
        "two packets at t = 10",
    ),
)
BY_ID = {ladder.id: ladder for ladder in LADDERS}
