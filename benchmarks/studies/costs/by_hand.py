"""Equations of motion as a user of heyoka would write them by hand, for problems in which a translation could lose.

Each function takes the problem and heyoka's variables q, p, arrays (d,), and returns the right-hand sides (q', p').
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import combinations
from typing import Any

import heyoka as hy
import numpy as np

from phasebench.benchmarks.problems import butane

Sides = list[Any]
#: A bond of two bodies, the first of which is None for the origin.
Bond = tuple[int | None, int]


def _sum(terms: Iterable[Any]) -> Any:
    return hy.sum(list(terms))


def _solve(A: list[list[Any]], b: Sides) -> Sides:
    """Solve A x = b for a symmetric A, whose upper triangle is given, with None for 0."""
    m, x = len(b), [None] * len(b)
    for k in range(m):
        for i in (i for i in range(k + 1, m) if A[k][i] is not None):
            multiple = A[k][i] / A[k][k]
            for j in (j for j in range(i, m) if A[k][j] is not None):
                A[i][j] = -(multiple * A[k][j]) if A[i][j] is None else A[i][j] - multiple * A[k][j]
            b[i] = b[i] - multiple * b[k]
    for k in reversed(range(m)):
        later = [A[k][j] * x[j] for j in range(k + 1, m) if A[k][j] is not None]
        x[k] = (b[k] - _sum(later) if later else b[k]) / A[k][k]
    return x


def _bound(q: Any, p: Any, masses: Sequence[float], bonds: Sequence[Bond], forces: Any = None) -> Sides:
    """Bodies at fixed distances: each bond's difference and G M^-1 G^T formed once, the multipliers eliminated."""
    n = len(masses)
    at, v = (x.reshape(n, -1) for x in (q, p))
    v = np.array([x if m == 1 else x * (1 / m) for x, m in zip(v, masses, strict=True)])
    ends = np.array([[(k == j) - (k == i) for k in range(n)] for i, j in bonds])
    weights = ((ends / masses) @ ends.T).tolist()

    def differences(x: Any) -> list[Any]:
        return [x[j] if i is None else x[j] - x[i] for i, j in bonds]

    r, w = differences(at), differences(v)
    A = [[x * _sum(r[a] * r[b]) if a <= b and x else None for b, x in enumerate(row)] for a, row in enumerate(weights)]
    b = [_sum(x * x) for x in w]
    if forces is not None:
        pull = differences([f * (1 / m) for f, m in zip(forces, masses, strict=True)])
        b = [x + _sum(y * z) for x, y, z in zip(b, r, pull, strict=True)]
    tension = [x * t for x, t in zip(r, _solve(A, b), strict=True)]
    dp = []
    for k in range(n):
        own = [-t if k == j else t for t, (i, j) in zip(tension, bonds, strict=True) if k in (i, j)]
        dp += map(_sum, zip(*([] if forces is None else [forces[k]]), *own, strict=True))
    return [*v.flat, *dp]


def _weight(problem: Any, masses: Sequence[float], across: int) -> Any:
    zero, g = hy.expression(0.0), problem.parameters["g"]
    return np.array([[zero] * across + [hy.expression(-m * g)] for m in masses])


def _double_pendulum(problem: Any, q: Any, p: Any) -> Sides:
    masses = [problem.parameters[name] for name in ("m1", "m2")]
    return _bound(q, p, masses, [(None, 0), (0, 1)], _weight(problem, masses, 1))


def _butane(problem: Any, q: Any, p: Any) -> Sides:
    """The force of the torsion through the dot products of the bonds, (b0 x b1).(b1 x b2) = b01 b12 - b02 b11."""
    at = q.reshape(4, 3)
    b = at[1:] - at[:-1]
    (b00, b01, b02), (_, b11, b12), (_, _, b22) = ([_sum(x * y) for y in b] for x in b)
    n, first, second = b01 * b12 - b02 * b11, b00 * b11 - b01 * b01, b11 * b22 - b12 * b12
    root = (first * second) ** -0.5
    cosine = -(n * root)
    a = [float(x) for x in butane.TORSION]
    slope = hy.expression(5 * a[5])
    for k in (4, 3, 2, 1):
        slope = slope * cosine + k * a[k]
    whole = slope * cosine
    of_n, of_first, of_second = -(slope * root), -0.5 * (whole / first), -0.5 * (whole / second)
    w01, w12 = of_n * b12 - 2.0 * (of_first * b01), of_n * b01 - 2.0 * (of_second * b12)
    w02, w11 = -(of_n * b11), hy.sum([of_first * b00, of_second * b22, -(of_n * b02)])
    weights = [[2.0 * (of_first * b11), w01, w02], [w01, 2.0 * w11, w12], [w02, w12, 2.0 * (of_second * b11)]]
    slopes = np.array([[_sum(line * x) for x in b.T] for line in np.array(weights)])
    forces = [slopes[0], slopes[1] - slopes[0], slopes[2] - slopes[1], -slopes[2]]
    bonds = [(0, 1), (1, 2), (2, 3), (0, 2), (1, 3)]
    return _bound(q, p, [float(m) for m in butane.MASSES], bonds, forces)


def _lennard_jones(problem: Any, q: Any, p: Any) -> Sides:
    at = q.reshape(-1, 2)
    forces: list[list[Any]] = [[] for _ in at]
    for i, j in combinations(range(len(at)), 2):
        apart = at[j] - at[i]
        square = apart[0] * apart[0] + apart[1] * apart[1]
        push = (48.0 * square**-7.0 - 24.0 * square**-4.0) * apart
        forces[j].append(push)
        forces[i].append(-push)
    return [*p, *(_sum(x) for f in forces for x in np.transpose(f))]


def _kerr(problem: Any, q: Any, p: Any) -> Sides:
    a, E, L = (problem.parameters[name] for name in ("a", "E", "L"))
    (r, theta), (pr, pt) = q, p
    square, sine = r * r, hy.sin(theta)
    hole, sine2 = square - 2.0 * r + a * a, sine * sine
    ratio, inverse, turn = (E * square + (a * a * E - a * L)) / hole, 1.0 / sine2, a * a * (E * E - 1)
    both, kinetic = ratio * ratio, pr * pr
    S = hole * (kinetic - both) + pt * pt + L * L * inverse + turn * sine2 + (a * a - 2 * a * E * L)
    half = (r - 1.0) * (kinetic + both) - 2.0 * E * (ratio * r)
    turns = sine * hy.cos(theta) * (L * L * (inverse * inverse) - turn) / square
    return [hole * pr / square, pt / square, (S / r - half) / square, turns]


def _magnetized(problem: Any, q: Any, p: Any) -> Sides:
    E, L, beta = (problem.parameters[name] for name in ("E", "L", "beta"))
    (r, theta), (pr, pt) = q, p
    sine, inverse = hy.sin(theta), 1.0 / r
    arm, square = r * sine, inverse * inverse
    push = ((-L * L) * (arm * arm) ** -2.0 + beta * beta / 4) * arm
    falls = square * (inverse * (pt * pt) - pr * pr) - (E * E) * (r - 2.0) ** -2.0 - push * sine
    return [pr - 2.0 * (inverse * pr), square * pt, falls, -(push * (r * hy.cos(theta)))]


def _heavy_top(problem: Any, q: Any, p: Any) -> Sides:
    """For a centre of mass on the axis, x1 = 0, as it is by default."""
    P = problem.parameters
    units = [[(-1, 1), (1, 0), (1, 3), (-1, 2)], [(-1, 2), (-1, 3), (1, 0), (1, 1)], [(-1, 3), (1, 2), (-1, 1), (1, 0)]]
    dq: list[list[Any]] = [[] for _ in q]
    dp: list[list[Any]] = [[] for _ in q]
    for unit, moment in zip(units, (P["I1"], P["I2"], P["I3"]), strict=True):
        twice = [p[m] * q[j] if sign > 0 else -(p[m] * q[j]) for m, (sign, j) in enumerate(unit)]
        rate = (1 / (4 * moment)) * _sum(twice)
        for m, (sign, j) in enumerate(unit):
            dq[m].append(rate * q[j] if sign > 0 else -(rate * q[j]))
            dp[j].append(-(rate * p[m]) if sign > 0 else rate * p[m])
    a, b = q[0] * q[0] + q[3] * q[3], q[1] * q[1] + q[2] * q[2]
    inverse = (a + b) ** -2.0
    of_a, of_b = (-4.0 * P["x3"]) * (b * inverse), (4.0 * P["x3"]) * (a * inverse)
    for j, weight in enumerate((of_a, of_b, of_b, of_a)):
        dp[j].append(weight * q[j])
    return [*map(_sum, dq), *map(_sum, dp)]


#: Problem -> its equations written by hand.
SIDES: dict[str, Callable[[Any, Any, Any], Sides]] = {
    "spherical-pendulum": lambda problem, q, p: _bound(q, p, [1.0], [(None, 0)], _weight(problem, [1.0], 2)),
    "double-pendulum-cartesian": _double_pendulum,
    "four-points": lambda problem, q, p: _bound(q, p, [*problem.parameters.values()], [*combinations(range(4), 2)]),
    "butane": _butane,
    "lennard-jones": _lennard_jones,
    "kerr": _kerr,
    "magnetized-schwarzschild": _magnetized,
    "heavy-top": _heavy_top,
}
