"""Prepare the kernel of `stage_lanes` (Gauss's methods with stages in SIMD lanes), and decide where it is used."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np

from phasebench.integrators.coefficients.tableaus import LEVELS, tableau
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.stepping.kernel import Prepared, array
from phasebench.integrators.systems.shared import lighter_gradient, motion, slopes
from phasebench.integrators.values import lane_formulae

from .lane_rows import FREE, components
from .stage_lanes import Lanes, run

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: Least number of stages for which lanes are faster.
FEWEST = 2


def serves(s: int, system: Hamiltonian) -> bool:
    """True if s stages should be evaluated side by side in SIMD lanes, and the system's functions allow it."""
    return s >= FEWEST and system.elementary


def pad(row: Sequence, lanes: int, filler: Any) -> list:
    """Fill up a row with ``filler`` to the length ``lanes``; returns a list."""
    return [*row, *[filler] * (lanes - len(row))]


def pad_square(rows: Iterable[Sequence], lanes: int) -> list[list]:
    """Fill up rows with zeros to a square matrix of ``lanes`` rows and columns; returns a list of lists."""
    rows = [pad(row, lanes, 0) for row in rows]
    return rows + [[0] * lanes] * (lanes - len(rows))


def _of_kicks(system: Hamiltonian, lanes: int, arithmetic: str, digits: int) -> tuple[Callable, np.ndarray]:
    """Make the function -grad V at ``lanes`` points at once, one in each SIMD lane; returns (the function, 1 / m_i).

    The inverse masses 1 / m_i are an array (1, d), computed with ``digits`` digits.
    """
    forces = lane_formulae.function(
        "forces", [("q", system.q)], lambda: slopes(system.potential, system.q, -1), lanes, system, arithmetic
    )
    masses = [mpmath.mpf(sp.diff(v, p).evalf(digits)) for v, p in zip(system.dq, system.p, strict=True)]
    return forces, array([masses], arithmetic)


def _of_both(system: Hamiltonian, lanes: int, arithmetic: str) -> tuple[Callable, None]:
    """Make the field (q', p') at ``lanes`` points at once, one in each SIMD lane; returns (the function, None)."""
    arguments = [("q", system.q), ("p", system.p)]
    return lane_formulae.function(
        "field", arguments, lambda: motion(system, lighter_gradient), lanes, system, arithmetic
    ), None


def functions(system: Hamiltonian, lanes: int, arithmetic: str, digits: int) -> tuple[Callable, np.ndarray | None]:
    """Make the function that a kernel in SIMD lanes evaluates at ``lanes`` stages at once, one in each lane.

    Returns (-grad V, the inverse masses 1 / m_i (1, d)) if H = sum p_i^2 / 2 m_i + V(q), else (the vector field, None).
    Inverse masses are computed with ``digits`` digits.
    """
    if system.diagonal:
        return _of_kicks(system, lanes, arithmetic, digits)
    return _of_both(system, lanes, arithmetic)


def start_weights(extrapolation: Sequence, s: int, lanes: int) -> Iterator[list]:
    """Yield the weights that extrapolate increments of earlier steps, row by row, padded to SIMD lanes.

    The first rows are for a start from one earlier step, the next from two, and so on.  ``extrapolation`` has the
    weights without padding, s rows for each number of earlier steps, with s the number of increments in a step.
    """
    for first in range(0, len(extrapolation), s):
        weights = list(zip(*extrapolation[first : first + s], strict=True))
        for step in range(0, len(weights), s):
            yield from pad_square(weights[step : step + s], lanes)


def build_lanes(s: int, system: Hamiltonian, arithmetic: str) -> Lanes:
    """Make the data `Lanes` of Gauss's method with s stages for a system.

    The coefficients are padded to a number of lanes that is a power of two; the system's functions are compiled for
    SIMD lanes.
    """
    lanes = 1 << (s - 1).bit_length()
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    kicks = system.diagonal
    t = tableau("gauss", s, s, kicks, digits, unit)
    b = [t.B[i][i] for i in range(s)]
    f, inverse_mass = functions(system, lanes, arithmetic, digits)
    late = t.weights[0] if kicks else [0] * s
    before, middle = [2 * (2 * i < s - 2) for i in range(s)], [int(abs(2 * i - s + 1) <= 1) for i in range(s)]
    nodes = [pad(t.c, lanes, t.c[0]), *(pad(row, lanes, 0) for row in (b, late, before, middle))]
    return Lanes(
        f,
        like=(0.0,) * lanes,
        stages=s,
        inverse_mass=inverse_mass,
        nodes=array(nodes, arithmetic),
        A=array(pad_square((pad(column, lanes, column[0]) for column in zip(*t.A_q, strict=True)), lanes), arithmetic),
        extrapolation=array(start_weights(t.extrapolation, s, lanes), arithmetic),
        steps=len(t.extrapolation) // s,
    )


def prepare(s: int, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of Gauss's method with s stages, in SIMD lanes, for a system."""
    step = build_lanes(s, system, arithmetic)
    return Prepared(run, step, *room(step, system.d), linear=len(step.like) * components(step.inverse_mass, system.d))


def room(step: Lanes, d: int) -> tuple[int, int]:
    """The memory that a kernel in SIMD lanes needs for d degrees of freedom, as fields of `Prepared`: (width, stages).

    ``width`` is the length of a row.  A run allocates a fixed number of rows for each stage, and ``stages`` is the
    least number of stages that gives the kernel enough rows.
    """
    rows = FREE + (6 + step.steps) * components(step.inverse_mass, d)
    return max(len(step.like), components(step.inverse_mass, d)), -(-rows // (3 * LEVELS + 1))
