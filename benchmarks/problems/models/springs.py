"""Models of the Fermi-Pasta-Ulam chain: only its soft springs move, the stiff ones are rigid or averaged."""

from __future__ import annotations

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems import fpu, problem
from phasebench.benchmarks.problems.base import Problem

from .ladder import Rung, model_problem


def soft_chain(order: int, omega: float = fpu.PARAMETERS["omega"]) -> Problem:
    """Make a model of the Fermi-Pasta-Ulam chain of which only the soft springs move.

    ``order`` selects the terms of size 1 / omega^2 that the stiff ones add to H: 0 none; 1 the mean effect of their
    oscillations, each at constant energy; 2 all such terms (see `fpu_models`).
    """
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
    return model_problem(f"fpu-slow-{order}", q0, p0, H, (full.q0[:m], tuple(map(float, start))))


def _with_springs(full: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Add the stiff springs to rows of the soft chain: they oscillate undisturbed from their initial state."""
    m, w = full.system.d // 2, full.parameters["omega"]
    a, b = np.array(full.q0[m:]), np.array(full.p0[m:]) / w
    c, s = np.cos(w * t)[:, None], np.sin(w * t)[:, None]
    return np.hstack([q, a * c + b * s]), np.hstack([p, w * (b * c - a * s)])


def fpu_models() -> tuple[Rung, ...]:
    r"""Return the models of the Fermi-Pasta-Ulam chain, from rigid stiff springs to the full problem.

    There are four models.  In the first the stiff springs are rigid.  In the second each of them adds the mean effect
    of its oscillation, at constant energy I, to the potential U of the soft springs:
    :math:`\tfrac12 U_{q_1q_1}\langle q_1^2\rangle` with :math:`\langle q_1^2\rangle = I/\omega^2`.  The third has two
    corrections of order :math:`\omega^{-2}` more: the energy :math:`-U_{q_1}^2/(2\omega^2)` of the stiff springs'
    displacement by the soft forces, and a shift of the initial slow momenta to their mean
    :math:`p_0 - U_{q_0q_1}p_1/\omega^2`.  The fourth is the full problem.
    """
    names = ("rigid springs", "averaged, invariants frozen", "averaged, all of order 1/omega^2")
    slow = (Rung(name, lambda k=k: soft_chain(k), _with_springs, steps=20) for k, name in enumerate(names))
    return *slow, Rung("stiff springs", lambda: problem("fpu"))
