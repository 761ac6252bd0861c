"""Models of the Klein-Gordon equation on a grid: without its nonlinear term, and on fewer points."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems import klein_gordon, problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.systems.hand import HandHamiltonian

from .ladder import Rung


def linear_waves() -> Problem:
    """Make the problem "klein-gordon" without its nonlinear term, on the same points from the same start."""
    full = problem("klein-gordon")
    N, L = full.parameters["N"], full.parameters["L"]
    q, p, H = klein_gordon.formula(N, L)
    loops = {"field": klein_gordon.field, "grad_V": klein_gordon.grad_V, "energy": klein_gordon.energy}
    a, b = klein_gordon.constants(N, L)
    H -= sp.Add(*(sp.Rational(b.numerator, b.denominator) * (q[j] ** 2 + q[N + j] ** 2) ** 2 / 4 for j in range(N)))
    system = HandHamiltonian(q=q, p=p, H=H, loops=loops, constants=(a, a * 0), degree=2)
    return replace(full, id="linear-klein-gordon", system=system)


def interpolate(full: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Map rows on n points of a period to the N points of ``full`` by trigonometric interpolation; t is not used."""
    N = full.parameters["N"]

    def finer(z: np.ndarray) -> np.ndarray:
        n = z.shape[1] // 2
        modes = np.fft.fft(z[:, :n] + 1j * z[:, n:], axis=1)
        wide = np.zeros((len(z), N), complex)
        wide[:, : n // 2], wide[:, N - n // 2 + 1 :] = modes[:, : n // 2], modes[:, n // 2 + 1 :]
        wide[:, n // 2] = wide[:, N - n // 2] = modes[:, n // 2] / 2
        # the values are scaled by the root of the distance of points
        field = np.fft.ifft(wide, axis=1) * sqrt(N / n)
        return np.hstack([field.real, field.imag])

    return finer(q), finer(p)


def lattice(N: int) -> Rung:
    """Make the model on only N points of the same period, interpolated to the points of the full problem."""
    return Rung(f"{N} points", lambda: problem("klein-gordon", N=N), interpolate)


FULL_WAVES = Rung("Klein-Gordon, 64 points", lambda: problem("klein-gordon"))
