r"""The local conservation laws of box schemes, in every cell of space-time.

A step gives the densities d at :math:`t_n` and :math:`t_{n+1}` and the fluxes f through the cells' ends, of the stages
with the weights of the method; the residual of a law in a cell is

.. math:: \frac{d^{n+1}_m - d^n_m}{h} + \frac{f_{m+1} - f_m}{\Delta x},

for the two-form of two solutions of the linearized scheme, for the energy and for the momentum.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.integrators.families.multisymplectic import Scheme, Step, Tangent
from phasebench.integrators.systems.multisymplectic import Division

#: The laws: the two-form with the parameter held and with it following the state, energy, momentum.
TWO_FORM, FOLLOWS, ENERGY, MOMENTUM = "two-form", "two-form, parameter follows", "energy law", "momentum law"
EPS = float(np.finfo(float).eps)


@dataclass
class Residuals:
    """The largest residual of a law so far, the largest of its terms, and one unit of round-off."""

    worst: float = 0.0
    term: float = 0.0
    unit: float = 0.0

    def add(self, terms, unit: float) -> None:
        """The change and the flow of a law in the cells of a step."""
        change, flow = terms
        self.worst = max(self.worst, float(np.abs(change + flow).max()))
        self.term = max(self.term, float(np.abs(change).max()), float(np.abs(flow).max()))
        self.unit = max(self.unit, unit)

    def row(self, name: str) -> dict[str, float]:
        """The columns of a law."""
        return {name: self.worst, f"{name}, largest term": self.term, f"{name}, round-off": self.unit}


def steepest(space: Division) -> float:
    """The largest slope that values of size one can have."""
    return float(np.linalg.norm(space.slope(np.eye(space.N)), 2))


def weighted(scheme: Scheme, flux, *stages):
    """The flux of a step: the mean of the stages' with the weights of the method, or that of their mean."""
    if scheme.means:
        return flux(*(np.tensordot(scheme.b, x, 1) for x in stages))
    return sum(b * flux(*(x[i] for x in stages)) for i, b in enumerate(scheme.b))


def two_form(space: Division, scheme: Scheme, pair: tuple[Tangent, Tangent], h: float):
    """The terms of the multisymplectic law, arrays (N,)."""
    u, v = pair
    K = space.equation.K[: space.equation.moving, : space.equation.moving]

    def density(a, b):
        return np.einsum("mi,ij,mj->m", a, K, b)

    flux = weighted(scheme, space.two_form, space.lifted(u.Y), space.lifted(v.Y))
    return (density(u.end, v.end) - density(u.start, v.start)) / h, space.divergence(flux)


def _law(space, scheme, step: Step, h, density, flux):
    z, rate = space.lifted(step.Y), space.lifted(step.T)
    change = (density(space.lifted(step.end)) - density(space.lifted(step.start))) / h
    return change, space.divergence(weighted(scheme, flux, z, rate))


def energy(space: Division, scheme: Scheme, step: Step, h: float):
    """The terms of the energy law, arrays (N,)."""
    return _law(space, scheme, step, h, space.energy, space.energy_flux)


def momentum(space: Division, scheme: Scheme, step: Step, h: float):
    """The terms of the momentum law, arrays (N,)."""
    return _law(space, scheme, step, h, space.momentum, space.momentum_flux)


def measure(space: Division, scheme: Scheme, steps: Iterable[Step], h: float, invariant) -> dict[str, float]:
    """The residuals of the laws over steps that carry two tangents, and what becomes of energy and ``invariant``.

    One unit of round-off is eps (D^2 + 1 / h) of products of two tangents, and eps D^2 / h of two values, with D of
    `steepest`: the last digit of a value is multiplied by that in the highest mode.
    """
    laws = {name: Residuals() for name in (TWO_FORM, FOLLOWS, ENERGY, MOMENTUM)}
    D = steepest(space)
    kept: dict[str, list[float]] = {"energies": [], "invariants": []}
    missed, alpha = 0, 0.0
    for step in steps:
        for name, pair in ((TWO_FORM, step.tangents), (FOLLOWS, step.moving)):
            size = np.prod([np.abs(t.start).max() for t in pair])
            laws[name].add(two_form(space, scheme, pair, h), EPS * (D**2 + 1 / h) * size)
        unit = EPS * D**2 / h * np.abs(step.start).max() ** 2
        laws[ENERGY].add(energy(space, scheme, step, h), unit)
        laws[MOMENTUM].add(momentum(space, scheme, step, h), unit)
        for y in (step.start, step.end)[bool(kept["energies"]) :]:
            kept["energies"].append(space.total_energy(y))
            kept["invariants"].append(invariant(y))
        missed, alpha = missed + (not step.found), max(alpha, abs(step.alpha))
    row = {column: value for name, law in laws.items() for column, value in law.row(name).items()}
    return row | {
        "total energy error": metrics.invariant_error(kept["energies"]).max,
        "quadratic invariant error": metrics.invariant_error(kept["invariants"]).max,
        "steps without a root": missed,
        "largest parameter": alpha,
    }
