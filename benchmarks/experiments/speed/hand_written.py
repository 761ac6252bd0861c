"""Equations of motion as a user of heyoka would write them by hand, for problems in which a translation could lose.

Each function takes the problem and heyoka's variables (q, p), and returns the right-hand sides (q', p').
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any

from phasebench.benchmarks.problems import butane

Sides = list[Any]
#: A bond of two bodies, the first of which is None for the origin.
Bond = tuple[int | None, int]


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    import heyoka as hy

    return hy.sum([x * y for x, y in zip(a, b, strict=True)])


def _solve(A: list[list[Any]], b: list[Any]) -> list[Any]:
    """Solve A x = b for a symmetric A, whose upper triangle is given, with None for 0."""
    import heyoka as hy

    m, x = len(b), [None] * len(b)
    for k in range(m):
        for i in (i for i in range(k + 1, m) if A[k][i] is not None):
            multiple = A[k][i] / A[k][k]
            for j in (j for j in range(i, m) if A[k][j] is not None):
                A[i][j] = -(multiple * A[k][j]) if A[i][j] is None else A[i][j] - multiple * A[k][j]
            b[i] = b[i] - multiple * b[k]
    for k in reversed(range(m)):
        later = [A[k][j] * x[j] for j in range(k + 1, m) if A[k][j] is not None]
        x[k] = (b[k] - hy.sum(later) if later else b[k]) / A[k][k]
    return x


def _bound(q: Sides, p: Sides, masses: Sequence[float], bonds: Sequence[Bond], forces: list[list[Any]] | None) -> Sides:
    """Bodies at fixed distances: each bond's difference and G M^-1 G^T formed once, the multipliers eliminated."""
    import heyoka as hy

    n, D = len(masses), len(q) // len(masses)
    v = [x if masses[i // D] == 1 else x * (1 / masses[i // D]) for i, x in enumerate(p)]

    def differences(x: Sequence[Any]) -> list[list[Any]]:
        at = [x[D * k : D * k + D] for k in range(n)]
        return [at[j] if i is None else [b - a for a, b in zip(at[i], at[j], strict=True)] for i, j in bonds]

    def end(bond: Bond, k: int) -> int:
        return (k == bond[1]) - (k == bond[0])

    r, w, A = differences(q), differences(v), [[None] * len(bonds) for _ in bonds]
    for a, b in combinations(range(len(bonds)), 2):
        common = sum(end(bonds[a], k) * end(bonds[b], k) / m for k, m in enumerate(masses))
        A[a][b] = common * _dot(r[a], r[b]) if common else None
    b = []
    pull = differences([x * (1 / masses[k]) for k, f in enumerate(forces) for x in f]) if forces else None
    for k, bond in enumerate(bonds):
        A[k][k] = sum(abs(end(bond, i)) / m for i, m in enumerate(masses)) * _dot(r[k], r[k])
        b.append(_dot(w[k], w[k]) + (_dot(r[k], pull[k]) if forces else 0.0))
    tension = [[x * t for x in line] for line, t in zip(r, _solve(A, b), strict=True)]
    dp = []
    for k, c in ((k, c) for k in range(n) for c in range(D)):
        terms = [forces[k][c]] if forces else []
        terms += [-tension[i][c] if k == bond[1] else tension[i][c] for i, bond in enumerate(bonds) if k in bond]
        dp.append(hy.sum(terms))
    return [*v, *dp]


def _pendulum(problem: Any, q: Sides, p: Sides) -> Sides:
    import heyoka as hy

    down = [hy.expression(0.0)] * 2 + [hy.expression(-problem.parameters["g"])]
    return _bound(q, p, [1.0], [(None, 0)], [down])


def _double_pendulum(problem: Any, q: Sides, p: Sides) -> Sides:
    import heyoka as hy

    masses = [problem.parameters[name] for name in ("m1", "m2")]
    down = [[hy.expression(0.0), hy.expression(-m * problem.parameters["g"])] for m in masses]
    return _bound(q, p, masses, [(None, 0), (0, 1)], down)


def _four_points(problem: Any, q: Sides, p: Sides) -> Sides:
    return _bound(q, p, [*problem.parameters.values()], list(combinations(range(4), 2)), None)


def _butane(problem: Any, q: Sides, p: Sides) -> Sides:
    """The force of the torsion through the dot products of the bonds, (b0 x b1).(b1 x b2) = b01 b12 - b02 b11."""
    import heyoka as hy

    at = [q[3 * k : 3 * k + 3] for k in range(4)]
    b = [[y - x for x, y in zip(at[k], at[k + 1], strict=True)] for k in range(3)]
    b01, b12, b02 = _dot(b[0], b[1]), _dot(b[1], b[2]), _dot(b[0], b[2])
    b00, b11, b22 = (_dot(x, x) for x in b)
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
    w00, w22 = of_first * b11, of_second * b11
    weights = [[2.0 * w00, w01, w02], [w01, 2.0 * w11, w12], [w02, w12, 2.0 * w22]]
    slopes = [[hy.sum([w * x[c] for w, x in zip(line, b, strict=True)]) for c in range(3)] for line in weights]
    ends = [slopes[0], *([y - x for x, y in zip(slopes[k], slopes[k + 1], strict=True)] for k in (0, 1))]
    forces = [*ends, [-x for x in slopes[2]]]
    bonds = [(0, 1), (1, 2), (2, 3), (0, 2), (1, 3)]
    return _bound(q, p, [float(m) for m in butane.MASSES], bonds, forces)


def _lennard_jones(problem: Any, q: Sides, p: Sides) -> Sides:
    import heyoka as hy

    forces: list[list[Any]] = [[] for _ in q]
    for i, j in combinations(range(len(q) // 2), 2):
        apart = [q[2 * j + c] - q[2 * i + c] for c in range(2)]
        square = apart[0] * apart[0] + apart[1] * apart[1]
        strength = 48.0 * square**-7.0 - 24.0 * square**-4.0
        for c, x in enumerate(apart):
            forces[2 * j + c].append(strength * x)
            forces[2 * i + c].append(-(strength * x))
    return [*p, *map(hy.sum, forces)]


def _kerr(problem: Any, q: Sides, p: Sides) -> Sides:
    import heyoka as hy

    a, E, L = (problem.parameters[name] for name in ("a", "E", "L"))
    (r, theta), (pr, pt) = q, p
    square, sine = r * r, hy.sin(theta)
    hole, sine2 = square - 2.0 * r + a * a, sine * sine
    ratio, inverse, turn = (E * square + (a * a * E - a * L)) / hole, 1.0 / sine2, a * a * (E * E - 1)
    both, kinetic = ratio * ratio, pr * pr
    S = hole * (kinetic - both) + pt * pt + L * L * inverse + turn * sine2 + (a * a - 2 * a * E * L)
    half = (r - 1.0) * (kinetic + both) - 2.0 * E * (ratio * r)
    falls = (S / r - half) / square
    return [
        hole * pr / square,
        pt / square,
        falls,
        sine * hy.cos(theta) * (L * L * (inverse * inverse) - turn) / square,
    ]


def _magnetized(problem: Any, q: Sides, p: Sides) -> Sides:
    import heyoka as hy

    E, L, beta = (problem.parameters[name] for name in ("E", "L", "beta"))
    (r, theta), (pr, pt) = q, p
    sine, inverse = hy.sin(theta), 1.0 / r
    arm, square = r * sine, inverse * inverse
    rho = arm * arm
    push = ((-L * L) * rho**-2.0 + beta * beta / 4) * arm
    falls = square * (inverse * (pt * pt) - pr * pr) - (E * E) * (r - 2.0) ** -2.0 - push * sine
    return [pr - 2.0 * (inverse * pr), square * pt, falls, -(push * (r * hy.cos(theta)))]


def _heavy_top(problem: Any, q: Sides, p: Sides) -> Sides:
    """For a centre of mass on the axis, x1 = 0, as it is by default."""
    import heyoka as hy

    P = problem.parameters
    units = [[(-1, 1), (1, 0), (1, 3), (-1, 2)], [(-1, 2), (-1, 3), (1, 0), (1, 1)], [(-1, 3), (1, 2), (-1, 1), (1, 0)]]
    rates = []
    for unit, moment in zip(units, (P["I1"], P["I2"], P["I3"]), strict=True):
        twice = hy.sum([p[m] * q[j] if sign > 0 else -(p[m] * q[j]) for m, (sign, j) in enumerate(unit)])
        rates.append((1 / (4 * moment)) * twice)
    dq: list[list[Any]] = [[] for _ in q]
    dp: list[list[Any]] = [[] for _ in q]
    for unit, rate in zip(units, rates, strict=True):
        for m, (sign, j) in enumerate(unit):
            dq[m].append(rate * q[j] if sign > 0 else -(rate * q[j]))
            dp[j].append(-(rate * p[m]) if sign > 0 else rate * p[m])
    a, b = q[0] * q[0] + q[3] * q[3], q[1] * q[1] + q[2] * q[2]
    inverse = (a + b) ** -2.0
    of_a, of_b = (-4.0 * P["x3"]) * (b * inverse), (4.0 * P["x3"]) * (a * inverse)
    for j, weight in enumerate((of_a, of_b, of_b, of_a)):
        dp[j].append(weight * q[j])
    return [*map(hy.sum, dq), *map(hy.sum, dp)]


#: Problem -> its equations written by hand.
SIDES: dict[str, Callable[[Any, Sides, Sides], Sides]] = {
    "spherical-pendulum": _pendulum,
    "double-pendulum-cartesian": _double_pendulum,
    "four-points": _four_points,
    "butane": _butane,
    "lennard-jones": _lennard_jones,
    "kerr": _kerr,
    "magnetized-schwarzschild": _magnetized,
    "heavy-top": _heavy_top,
}
