"""LADDERS: problems with a span and a quantity to compute, each with models from the simplest to the full problem."""

from __future__ import annotations

from .ladder import Ladder, Rung
from .one_body import kepler_models, pendulum_models
from .planets import particle_models, planet_models
from .springs import fpu_models
from .waves import FULL_WAVES, lattice, linear_waves

#: (e, mu) of the Schwarzschild term: the suite's own orbit, and one weak enough for averaging.
STRONG, WEAK = (0.6, 0.0075), (0.2, 1e-6)
AMPLITUDES = (0.1, 0.5, 2.0)


def _pendulum(amplitude: float) -> Ladder:
    rungs = pendulum_models(amplitude)
    return Ladder(f"pendulum-{amplitude:g}", "pendulum:swinging", 10.0, "end-state", 5, rungs)


def _kepler(id: str, term: tuple[float, float], t_end: float, quantity: str, steps: int) -> Ladder:
    named = tuple(zip(("e", "mu"), term, strict=True))
    return Ladder(id, "perturbed-kepler", t_end, quantity, steps, kepler_models(*term), named)


def _planet(id: str, t_end: float, name: str, steps: int, rungs: tuple[Rung, ...]) -> Ladder:
    return Ladder(id, "outer-solar-system", t_end, f"{name}-longitude", steps, rungs)


def _waves(id: str, *lower: Rung) -> Ladder:
    return Ladder(id, "klein-gordon", 10.0, "end-state", 20, (*lower, FULL_WAVES))


LADDERS: tuple[Ladder, ...] = (
    *map(_pendulum, AMPLITUDES),
    _kepler("kepler-strong", STRONG, 10.0, "end-state", 40),
    _kepler("kepler-strong-perihelion", STRONG, 1000.0, "perihelion", 4000),
    _kepler("kepler-weak-perihelion", WEAK, 1000.0, "perihelion", 2000),
    _planet("jupiter-14-years", 5000.0, "jupiter", 10, planet_models()),
    _planet("jupiter-1400-years", 500_000.0, "jupiter", 1000, planet_models()),
    _planet("saturn-140-years", 50_000.0, "saturn", 100, particle_models()),
    Ladder("fpu-soft-chain", "fpu", 20.0, "slow-positions", 500, fpu_models()),
    _waves("klein-gordon-linear", Rung("linear waves", linear_waves)),
    _waves("klein-gordon-points", *map(lattice, (16, 32, 48))),
)
BY_ID = {ladder.id: ladder for ladder in LADDERS}
