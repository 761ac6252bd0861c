"""QUESTIONS, the scenes on which costs are compared: a quantity of a problem at a time, and accuracies to reach.

Each such scene is a `Question`.  The study `studies.trade` compares the costs at which integrators reach an
accuracy.  (A `Scene` of `scenes` is another thing: it has steps at which errors are compared with stored ones.)  The
accuracies fall from 1e-1 (a picture needs about 1e-2, an ephemeris 1e-12) as far as doubles and the reference's
uncertainty allow.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .base import Problem


def down_to(last: int) -> tuple[float, ...]:
    """Return the accuracies (errors) 1e-1, 1e-2, ... down to ten to the minus ``last``."""
    return tuple(10.0**-k for k in range(1, last + 1))


@dataclass(frozen=True)
class Question:
    """A scene on which costs are compared: a problem, a time span, and a quantity to compute to given accuracies.

    Attributes
    ----------
    id : kebab-case name
    problem : ``id:orbit``
    t_end : the end of the span, in the problem's own unit of time
    quantity : the name of a quantity (`benchmarks.measure.quantities`)
    accuracies : falling errors, for each of which the cheapest integration is searched
    about : a description in one line
    """

    id: str
    problem: str
    t_end: float
    quantity: str
    accuracies: tuple[float, ...]
    about: str

    def build_problem(self) -> Problem:
        """Return the `Problem` of the question, on its orbit."""
        from . import problem

        return problem(self.problem)


#: The figure eight's period, rounded as its certified times are.
EIGHT = 6.32591398
QUESTIONS: tuple[Question, ...] = (
    Question(
        "oscillator-phase", "harmonic-oscillator", 1000.0, "phase", down_to(12), "the phase after 159 oscillations"
    ),
    Question("pendulum-short", "pendulum:swinging", 10.0, "end-state", down_to(13), "the state after one swing"),
    Question("pendulum-long", "pendulum:swinging", 1000.0, "end-state", down_to(11), "the state after 120 swings"),
    Question("pendulum-energy", "pendulum:rotating", 1e5, "energy", down_to(10), "the energy over 35,000 rotations"),
    Question(
        "spherical-pendulum", "spherical-pendulum", 100.0, "end-state", down_to(12), "the state after 20 oscillations"
    ),
    Question(
        "magnetized-schwarzschild",
        "magnetized-schwarzschild:inner",
        1000.0,
        "end-state",
        down_to(12),
        "a charge around a black hole in a magnetic field",
    ),
    Question("kerr", "kerr", 1000.0, "end-state", down_to(12), "a body around a rotating black hole"),
    Question("free-rigid-body", "free-rigid-body:tumbling", 100.0, "end-state", down_to(12), "six turns over"),
    Question("heavy-top", "heavy-top:nutating", 100.0, "end-state", down_to(12), "the state after 33 nutations"),
    Question(
        "double-pendulum-cartesian",
        "double-pendulum-cartesian:regular",
        100.0,
        "end-state",
        down_to(12),
        "two points by constraints after 12 oscillations",
    ),
    Question("four-points", "four-points", 10.0, "end-state", down_to(12), "a rigid body of four points, two turns"),
    Question("butane", "butane", 10.0, "end-state", down_to(12), "a molecule of fixed bonds and angles after 2 ps"),
    Question("kepler-orbit", "kepler", 2 * pi, "end-state", down_to(13), "the state after one revolution, e = 0.6"),
    Question("kepler-phase", "kepler", 200 * pi, "phase", down_to(11), "where the planet is after 100 revolutions"),
    Question(
        "kepler-perihelion", "kepler", 2000 * pi, "perihelion", down_to(12), "the perihelion after 1000 revolutions"
    ),
    Question(
        "perturbed-kepler-short",
        "perturbed-kepler",
        100.0,
        "trajectory",
        down_to(13),
        "the trajectory over 16 revolutions of a precessing orbit",
    ),
    Question(
        "perturbed-kepler-long",
        "perturbed-kepler",
        1000.0,
        "end-state",
        down_to(11),
        "the state after 160 revolutions of a precessing orbit",
    ),
    Question(
        "perturbed-kepler-perihelion",
        "perturbed-kepler",
        1e4,
        "perihelion",
        down_to(10),
        "the perihelion after 1600 revolutions",
    ),
    Question(
        "henon-heiles-box-short",
        "henon-heiles:box",
        10.0,
        "trajectory",
        down_to(13),
        "the trajectory of one and a half oscillations",
    ),
    Question("henon-heiles-box-long", "henon-heiles:box", 1000.0, "end-state", down_to(13), "the state at t = 1000"),
    Question(
        "henon-heiles-section", "henon-heiles:box", 1000.0, "section", down_to(13), "the point of a Poincare section"
    ),
    Question("henon-heiles-energy", "henon-heiles:box", 1e5, "energy", down_to(12), "the energy over t = 1e5"),
    Question(
        "henon-heiles-chaotic", "henon-heiles:chaotic", 100.0, "end-state", down_to(8), "the state of a chaotic orbit"
    ),
    Question(
        "henon-heiles-average",
        "henon-heiles:chaotic",
        1e4,
        "average",
        (1e-1, 3e-2, 1e-2),
        "the average of the kinetic energy over a chaotic orbit",
    ),
    Question(
        "henon-heiles-lyapunov",
        "henon-heiles:chaotic",
        1e4,
        "lyapunov",
        (1e-1, 5e-2),
        "the largest Lyapunov exponent",
    ),
    Question(
        "outer-planets-short",
        "outer-solar-system",
        5000.0,
        "trajectory",
        down_to(13),
        "the planets over 14 years",
    ),
    Question(
        "outer-planets-jupiter",
        "outer-solar-system",
        500_000.0,
        "jupiter-longitude",
        down_to(12),
        "Jupiter's longitude after 1400 years",
    ),
    Question("lotka-volterra", "lotka-volterra:4-2", 120.0, "end-state", down_to(12), "the populations at t = 120"),
    Question(
        "lotka-volterra-log", "lotka-volterra-log:4-2", 120.0, "trajectory", down_to(12), "their logarithms to t = 120"
    ),
    Question(
        "fpu-short", "fpu", 20.0, "end-state", down_to(12), "the state of stiff springs over 160 fast oscillations"
    ),
    Question(
        "fpu-adiabatic",
        "fpu",
        200.0,
        "adiabatic-invariant",
        down_to(8),
        "the oscillatory energy over 1600 fast oscillations",
    ),
    Question("double-pendulum", "double-pendulum:regular", 100.0, "end-state", down_to(12), "the state at t = 100"),
    Question(
        "double-pendulum-chaotic", "double-pendulum:chaotic", 10.0, "end-state", down_to(12), "the state at t = 10"
    ),
    Question("duffing", "duffing:both-wells", 200.0, "end-state", down_to(12), "the state at t = 200"),
    Question("quadrupole-boson", "quadrupole-boson:benchmark", 100.0, "end-state", down_to(11), "the state at t = 100"),
    Question("figure-eight", "figure-eight", 10 * EIGHT, "trajectory", down_to(12), "three bodies over ten periods"),
    Question("toda", "toda:three", 100.0, "end-state", down_to(12), "the state at t = 100"),
    Question("rigid-body", "rigid-body:around-e3", 200.0, "end-state", down_to(12), "the attitude at t = 200"),
    Question(
        "charged-particle", "charged-particle", 1000.0, "drift-angle", down_to(12), "how far it has drifted at t = 1000"
    ),
    Question(
        "magnetic-mirror", "magnetic-mirror", 1000.0, "end-state", down_to(11), "a particle in a mirror, at t = 1000"
    ),
    Question(
        "schwarzschild-azimuth",
        "schwarzschild:precessing",
        1000.0,
        "azimuth",
        down_to(12),
        "the azimuth of a strongly precessing orbit",
    ),
    Question("lennard-jones", "lennard-jones", 1.0, "end-state", down_to(12), "the atoms after 2 ps"),
    Question(
        "lennard-jones-temperature", "lennard-jones", 10.0, "average", down_to(3), "the mean temperature over 22 ps"
    ),
    Question("n-body", "n-body", 10.0, "end-state", down_to(8), "the Pythagorean three bodies at t = 10"),
    Question("nls", "nls:soliton", 5.0, "end-state", down_to(12), "a soliton at t = 5"),
    Question("klein-gordon", "klein-gordon", 10.0, "end-state", down_to(12), "two waves after their collision"),
)
BY_ID = {x.id: x for x in QUESTIONS}
