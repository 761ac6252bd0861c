"""PROBLEMS, the index of all test problems with their modules and orbits; and the check of parameter values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from numbers import Integral

from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import is_finite

#: Id -> (module, one line, its orbits: the first is the default).  A test compares it with the modules.
PROBLEMS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "harmonic-oscillator": ("harmonic_oscillator", "harmonic oscillator", ("unit",)),
    "pendulum": ("pendulum", "mathematical pendulum", ("swinging", "rotating")),
    "kepler": ("kepler", "Kepler problem", ("e",)),
    "perturbed-kepler": ("perturbed_kepler", "Kepler problem with the Schwarzschild term", ("e",)),
    "henon-heiles": ("henon_heiles", "Henon-Heiles", ("chaotic", "box")),
    "outer-solar-system": ("outer_solar_system", "the Sun and five outer planets", ("september-1994",)),
    "solar-system": ("solar_system", "the Sun and eight planets", ("j2000",)),
    "lotka-volterra": ("lotka_volterra", "Lotka-Volterra in its own variables", ("2-2", "4-8", "4-2", "6-2")),
    "lotka-volterra-log": ("lotka_volterra_log", "Lotka-Volterra in logarithms", ("2-2", "4-8", "4-2", "6-2")),
    "fpu": ("fpu", "Fermi-Pasta-Ulam with stiff springs", ("one-spring",)),
    "nls": ("nls", "nonlinear Schroedinger equation on N points", ("plane-wave", "soliton")),
    "klein-gordon": ("klein_gordon", "complex Klein-Gordon equation on N points", ("collision",)),
    "double-pendulum": ("double_pendulum", "double pendulum", ("chaotic", "regular")),
    "double-pendulum-cartesian": (
        "double_pendulum_cartesian",
        "double pendulum, two points by constraints",
        ("regular", "chaotic"),
    ),
    "spherical-pendulum": ("spherical_pendulum", "spherical pendulum, on the sphere by a constraint", ("tilted",)),
    "four-points": ("four_points", "free rigid body, four points by constraints", ("tumbling",)),
    "butane": ("butane", "butane, four atoms with fixed bonds and angles", ("turning",)),
    "duffing": ("duffing", "Duffing oscillator", ("one-well", "near-separatrix", "both-wells")),
    "quadrupole-boson": ("quadrupole_boson", "quadrupole boson Hamiltonian", ("benchmark", "h20")),
    "figure-eight": ("three_body", "figure eight of three bodies", ("simo",)),
    "toda": ("toda", "periodic Toda lattice", ("three", "cnoidal")),
    "rigid-body": (
        "rigid_body",
        "free rigid body in Andoyer's variables",
        ("around-e3", "around-e1", "near-separatrix"),
    ),
    "free-rigid-body": ("free_rigid_body", "free rigid body in quaternions", ("tumbling", "wobbling")),
    "heavy-top": ("heavy_top", "heavy top in quaternions", ("nutating", "slow")),
    "charged-particle": ("charged_particle", "charged particle in a magnetic field", ("drift",)),
    "magnetic-mirror": ("magnetic_mirror", "charged particle in a magnetic mirror", ("trapped",)),
    "schwarzschild": (
        "schwarzschild",
        "geodesics of the Schwarzschild metric",
        ("precessing", "zoom-whirl", "isco", "photon-sphere"),
    ),
    "magnetized-schwarzschild": (
        "magnetized_schwarzschild",
        "charged particle around a black hole in a magnetic field",
        ("inner", "outer"),
    ),
    "kerr": ("kerr", "geodesics of the Kerr metric, in a time that splits H", ("bound",)),
    "spinning-binary": ("spinning_binary", "two spinning black holes, post-Newtonian (2PN)", ("precessing",)),
    "lennard-jones": ("lennard_jones", "frozen argon crystal of seven atoms", ("argon",)),
    "n-body": ("n_body", "gravitational N-body problem", ("pythagorean",)),
}


def plain(value: object) -> object:
    """Return a finite real number of any type as int or float (equal keys of a cache), and anything else unchanged."""
    if not is_finite(value):
        return value
    return int(value) if isinstance(value, Integral) else float(value)


def real_parameters(what: str, known: Iterable[str], values: Mapping[str, object]) -> dict[str, int | float]:
    """Return parameters, name -> value, as ints and floats; ``what`` names their owner in messages.

    Raises InvalidInput for a name that is not ``known`` and for a value that is no finite number.
    """
    for key, value in values.items():
        if key not in known:
            has = f"has {', '.join(known)}" if known else "has none"
            raise InvalidInput(f"{what} has no parameter '{key}'; it {has}")
        if not is_finite(value):
            raise InvalidInput(f"the parameter {key} of {what} is {value!r:.80}; it must be a finite number")
    return {key: plain(value) for key, value in values.items()}
