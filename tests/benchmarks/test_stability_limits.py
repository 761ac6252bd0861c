"""Known stability limits, derived again exactly from the coefficients that the methods' authors give."""

from __future__ import annotations

import math
from functools import cache, partial

import pytest
import sympy as sp

from phasebench.benchmarks.studies.extremes import limits
from support import step_matrices as exact
from support.step_matrices import HALF, Z

CUBE = sp.N(sp.cbrt(2), exact.DIGITS)
OUTER = 1 / (2 - CUBE)
ROOT = sp.N(sp.cbrt(2 * sp.sqrt(326) + 36), exact.DIGITS)
MCLACHLAN = HALF - ROOT / 12 + 1 / (6 * ROOT)
SABA = sp.N(HALF - sp.sqrt(3) / 6, exact.DIGITS)
SQRT_HALF = sp.N(1 / sp.sqrt(2), exact.DIGITS)
R = sp.Rational
SIXTHS = (R(1, 6), R(2, 3), R(1, 6))


@cache
def midpoint():
    return exact.parametric((1, HALF))


@cache
def verlet():
    return exact.verlets(sp.Integer(1))


def scheme_i(lam):
    return exact.parametric((1, sp.Rational(lam)))


def scheme_iii(lam):
    return exact.parametric((HALF, 1 - sp.Rational(lam)), (HALF, sp.Rational(lam)))


#: Method -> function that returns the matrix of its step; for Schemes I and III a function of lambda.
MATRICES = {
    "symplectic-euler-p": lambda: exact.product(exact.kick(1), exact.drift(1)),
    "symplectic-euler-q": lambda: exact.product(exact.drift(1), exact.kick(1)),
    "stormer-verlet": verlet,
    "stormer-verlet-dkd": lambda: exact.product(exact.drift(HALF), exact.kick(1), exact.drift(HALF)),
    "lobatto-iiia-iiib-2": lambda: exact.runge_kutta([[0, 0], [HALF, HALF]], (HALF, HALF), [[HALF, 0], [HALF, 0]]),
    "lobatto-iiia-iiib-3": lambda: exact.runge_kutta(
        [[0, 0, 0], [R(5, 24), R(1, 3), -R(1, 24)], SIXTHS],
        SIXTHS,
        [[R(1, 6), -R(1, 6), 0], [R(1, 6), R(1, 3), 0], [R(1, 6), R(5, 6), 0]],
    ),
    "variational-trapezoidal": verlet,
    "explicit-euler": lambda: exact.runge_kutta([[0]], (1,)),
    "heun-2": lambda: exact.runge_kutta([[0, 0], [1, 0]], (HALF, HALF)),
    "kutta-3": lambda: exact.runge_kutta([[0, 0, 0], [HALF, 0, 0], [-1, 2, 0]], SIXTHS),
    "rk4": lambda: exact.runge_kutta(
        [[0, 0, 0, 0], [HALF, 0, 0, 0], [0, HALF, 0, 0], [0, 0, 1, 0]], (R(1, 6), R(1, 3), R(1, 3), R(1, 6))
    ),
    "mclachlan-s2": lambda: exact.two_stages(MCLACHLAN),
    "saba-2": lambda: exact.two_stages(SABA),
    "mclachlan-atela-2": lambda: exact.splitting((SQRT_HALF, 1 - SQRT_HALF), (SQRT_HALF, 1 - SQRT_HALF)),
    "ruth-3": lambda: exact.splitting((R(2, 3), -R(2, 3), 1), (R(7, 24), R(3, 4), -R(1, 24))),
    "forest-ruth": lambda: exact.verlets(OUTER, -CUBE * OUTER, OUTER),
    "implicit-euler": lambda: exact.runge_kutta([[1]], (1,)),
    "implicit-midpoint": midpoint,
    "gauss-2": lambda: exact.pade(2, 2),
    "gauss-4": lambda: exact.pade(4, 4),
    "radau-iia-3": lambda: exact.pade(2, 3),
    "imex": midpoint,
    "avf": midpoint,
    "scheme-i": scheme_i,
    "scheme-iii": scheme_iii,
}
#: Methods whose matrix is an exact rotation, not one of polynomials.
ROTATIONS = {"deuflhard"}


@pytest.mark.parametrize("limit", limits.LIMITS, ids=lambda k: f"{k['method']}{k.get('lam', '')}")
def test_limit_follows_from_the_matrix(limit):
    assert limit["derived"]
    if limit["method"] in ROTATIONS:
        assert limit["value"] == math.inf
        return
    end = exact.first_end(MATRICES[limit["method"]](*([limit["lam"]] if "lam" in limit else ())))
    assert float(end) == pytest.approx(limit["value"], rel=1e-14, abs=0)


def test_fifteen_limits_are_derived_others_have_a_source():
    assert len({k["method"] for k in limits.LIMITS}) >= 15
    printed = {k["printed"] for k in limits.LIMITS if "printed" in k}
    assert len(printed) >= 5
    assert all(any(c.isdigit() for c in limits.FILE["sources"][name]) for name in printed)


@pytest.mark.parametrize(
    ("matrix", "trace"),
    [
        (verlet, 2 - Z**2),
        (midpoint, 2 * (4 - Z**2) / (4 + Z**2)),
        (MATRICES["lobatto-iiia-iiib-3"], 2 * (48 - 22 * Z**2 + Z**4) / (48 + 2 * Z**2)),
        (partial(scheme_i, "-1"), 2 - Z**2 / (1 - 2 * Z**2)),
    ],
)
def test_traces_are_those_of_the_table(matrix, trace):
    matrix = matrix()
    assert sp.cancel(matrix.trace() - trace) == 0
    assert sp.cancel(matrix.det() - 1) == 0


def test_wrong_coefficient_gives_another_limit():
    """The sign of Ruth's last kick changed; thirds in place of Forest and Ruth's fractions."""
    wrong = exact.splitting((R(2, 3), -R(2, 3), 1), (R(7, 24), R(3, 4), R(1, 24)))
    assert abs(float(exact.first_end(wrong)) - 2.5074811709523557) > 1e-3
    thirds = exact.verlets(R(1, 3), R(1, 3), R(1, 3))
    assert float(exact.first_end(thirds)) == pytest.approx(6.0, abs=1e-12)
    assert exact.first_end(exact.runge_kutta([[0]], (1,))) == 0
    assert math.isinf(float(exact.first_end(midpoint())))
