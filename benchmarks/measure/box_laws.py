r"""Residuals of the local conservation laws of box schemes, in every cell (box) of the mesh in space-time.

A step gives the densities d at :math:`t_n` and :math:`t_{n+1}`, and the fluxes f through the ends of the cells as the
weighted sum over the stages; the residual of a law in a cell is

.. math:: \frac{d^{n+1}_m - d^n_m}{h} + \frac{f_{m+1} - f_m}{\Delta x},

for the two-form of two solutions of the linearized scheme, for the energy and for the momentum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.integrators.families.multisymplectic import Scheme, Step, Tangent
from phasebench.integrators.systems.multisymplectic import Division

#: The laws: the two-form with the scheme's parameter fixed, and with its dependence on the state; energy; momentum.
TWO_FORM, FOLLOWS, ENERGY, MOMENTUM = "two-form", "two-form, parameter follows", "energy law", "momentum law"
EPS = float(np.finfo(float).eps)


@dataclass
class Residuals:
    """The largest residual of a local conservation law over the steps so far.

    Attributes
    ----------
    worst, term : the largest residual, and the largest of the law's two terms, in absolute value
    unit : the size of one unit of round-off of the residual
    """

    worst: float = 0.0
    term: float = 0.0
    unit: float = 0.0

    def add(self, terms: tuple[np.ndarray, np.ndarray], unit: float) -> None:
        """Include a step: the density's change and the flux difference, arrays (N,), and the unit of round-off."""
        change, flow = terms
        self.worst = max(self.worst, float(np.abs(change + flow).max()))
        self.term = max(self.term, float(np.abs(change).max()), float(np.abs(flow).max()))
        self.unit = max(self.unit, unit)

    def row(self, name: str) -> dict[str, float]:
        """Return the columns of a row for the law ``name``."""
        return {name: self.worst, f"{name}, largest term": self.term, f"{name}, round-off": self.unit}


def steepest(space: Division) -> float:
    """Return the 2-norm of the discrete derivative in space, as a matrix on the N cells."""
    return float(np.linalg.norm(space.slope(np.eye(space.N)), 2))


def step_flux(scheme: Scheme, flux: Callable, *stages: np.ndarray) -> np.ndarray:
    """Return the flux of a step: the weighted sum of the stages' fluxes or, if ``scheme.means``, that of their mean.

    ``flux`` is a function of as many fields as there are ``stages``, arrays with the stages along the first axis.
    """
    if scheme.means:
        return flux(*(np.tensordot(scheme.b, x, 1) for x in stages))
    return sum(b * flux(*(x[i] for x in stages)) for i, b in enumerate(scheme.b))


def two_form(space: Division, scheme: Scheme, pair: tuple[Tangent, Tangent], h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (density's change, flux difference), arrays (N,) over cells, for a pair of tangents over one step h."""
    u, v = pair
    K = space.equation.K[: space.equation.moving, : space.equation.moving]

    def density(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("mi,ij,mj->m", a, K, b)

    flux = step_flux(scheme, space.two_form, space.lift(u.Y), space.lift(v.Y))
    return (density(u.end, v.end) - density(u.start, v.start)) / h, space.divergence(flux)


def _law(
    space: Division, scheme: Scheme, step: Step, h: float, density: Callable, flux: Callable
) -> tuple[np.ndarray, np.ndarray]:
    """Return (density's change, flux difference) of a law in a step h, arrays (N,) over cells."""
    z, rate = space.lift(step.Y), space.lift(step.T)
    change = (density(space.lift(step.end)) - density(space.lift(step.start))) / h
    return change, space.divergence(step_flux(scheme, flux, z, rate))


def measure(
    space: Division, scheme: Scheme, steps: Iterable[Step], h: float, invariant: Callable[[np.ndarray], float]
) -> dict[str, float]:
    """Measure the largest residuals of the discrete conservation laws over ``steps``, and the errors of totals.

    Returns the columns of a row.  ``invariant`` is a function of y.  The multisymplectic law is measured on the two
    tangents (solutions of the linearized scheme) that belong to each step.

    One unit of round-off is eps (D^2 + 1 / h) times the product of two tangents, and eps D^2 / h times that of two
    values, with D from `steepest`: in the highest mode, the last digit of a value grows by this factor.
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
        laws[ENERGY].add(_law(space, scheme, step, h, space.energy, space.energy_flux), unit)
        laws[MOMENTUM].add(_law(space, scheme, step, h, space.momentum, space.momentum_flux), unit)
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
