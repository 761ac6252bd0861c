"""Models of the motion of Jupiter and of Saturn: massless about the fixed Sun, then with more and more bodies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems import gravity, outer_solar_system, problem
from phasebench.benchmarks.problems.base import Problem

from .ladder import Lift, Rung, model_problem

BODIES = outer_solar_system.BODIES
MASSLESS = gravity.MASSLESS


def bodies(names: tuple[str, ...], massless: tuple[str, ...] = ()) -> Callable[[], Problem]:
    """Make a function that makes the problem of the bodies ``names``, those in ``massless`` as test particles."""

    def make() -> Problem:
        q, p, pairs, distances, _ = gravity.bodies(len(names), "xyz", first=0)
        m = [MASSLESS if n in massless else BODIES[n][0] for n in names]
        H = gravity.newton(p, [sp.Rational(x) for x in m], sp.Rational(outer_solar_system.G), pairs, distances)
        where = tuple(x for n in names for x in BODIES[n][1])
        momenta = tuple(mass * v for n, mass in zip(names, m, strict=True) for v in BODIES[n][2])
        return model_problem("-".join(names), q, p, H, (where, momenta))

    return make


def about_the_sun(name: str) -> Callable[[], Problem]:
    """Make a function that makes the problem of the planet ``name``, without mass, about the fixed Sun."""

    def make() -> Problem:
        q, p = sp.symbols("x y z", real=True), sp.symbols("u v w", real=True)
        M = sp.Rational(outer_solar_system.G) * sp.Rational(BODIES["sun"][0])
        H = sum(x**2 for x in p) / 2 - M / sp.sqrt(sum(x**2 for x in q))
        return model_problem(f"{name}-alone", q, p, H, BODIES[name][1:])

    return make


def of_bodies(*names: str) -> Lift:
    """Make the map of rows of a model of ``names`` to rows of all bodies: the Sun at rest, those left out NaN."""

    def lift(full: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        out = np.full((2, len(t), full.system.d), np.nan)
        out[:, :, :3] = 0.0
        for k, name in enumerate(names):
            at = 3 * list(BODIES).index(name)
            out[0, :, at : at + 3], out[1, :, at : at + 3] = q[:, 3 * k : 3 * k + 3], p[:, 3 * k : 3 * k + 3]
        return out[0], out[1]

    return lift


def planet_models() -> tuple[Rung, ...]:
    """Return the models of Jupiter's motion: without mass about the fixed Sun, then with more and more bodies."""
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
    """Return the models of Saturn's motion: a test particle of the Sun, then of Sun and Jupiter, then with its mass."""
    three = ("sun", "jupiter", "saturn")
    return (
        Rung("test particle of the Sun", about_the_sun("saturn"), of_bodies("saturn")),
        Rung("test particle of Sun and Jupiter", bodies(three, massless=("saturn",)), of_bodies(*three)),
        Rung("three bodies", bodies(three), of_bodies(*three)),
        Rung("all six bodies", lambda: problem("outer-solar-system")),
    )
