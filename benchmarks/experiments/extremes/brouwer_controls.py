r"""Stormer-Verlet on the oscillator in three arithmetics, to find which rounding makes the energy drift.

`PLAIN`: sums without compensation.  `HALF`: exact products in twice the digits (Veltkamp 1968; Dekker 1971) and
compensated sums, while velocity and force see the state rounded to a double.  `WHOLE`: as `HALF`, but
velocity and force also see the part of the state that is rounded off.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

PLAIN, HALF, WHOLE = "plain sums", "products exact", "products exact, of the whole state"
KINDS = (PLAIN, HALF, WHOLE)
SPLITTER = 2.0**27 + 1


def plain(h: float, every: int, rows: int, q: float, p: float) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the oscillator H = (p^2 + q^2) / 2 by leapfrog without compensated sums, from the state q, p.

    Returns arrays Q, P (rows + 1,): the start, and the state after each ``every`` steps of length h.
    """
    Q, P = np.empty(rows + 1), np.empty(rows + 1)
    Q[0], P[0] = q, p
    for i in range(rows):
        for _ in range(every):
            p = p - h / 2 * q
            q = q + h * p
            p = p - h / 2 * q
        Q[i + 1], P[i + 1] = q, p
    return Q, P


def careful(h: float, share: float, every: int, rows: int, q: float, p: float) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the oscillator by leapfrog with exact products and compensated sums, from the state q, p.

    Velocity and force see ``share`` (0 or 1) of the state's lost parts, which the compensated sums carry along.
    Returns arrays Q, P (rows + 1,): the start, and the state after each ``every`` steps of length h.
    """
    Q, P = np.empty(rows + 1), np.empty(rows + 1)
    Q[0], P[0] = q, p
    lost_q = lost_p = 0.0
    t = SPLITTER * h
    upper = t - (t - h)
    lower = h - upper
    for i in range(rows):
        for k in range(2 * every + 1):
            drift = k % 2 == 1
            x, c, y, lost = (q, lost_q, p, lost_p) if drift else (p, lost_p, q, lost_q)
            step = 1.0 if drift else (-0.5 if k == 0 or k == 2 * every else -1.0)  # halves and signs are exact
            product = h * y
            t = SPLITTER * y
            high = t - (t - y)
            low = y - high
            rest = ((upper * high - product) + upper * low + lower * high) + lower * low
            product, rest = step * product, step * (rest + share * h * lost)
            new = (x + c) + product
            moved = product + c
            c = (moved - (new - x)) + ((product - (moved - c)) + rest)
            if drift:
                q, lost_q = new, c
            else:
                p, lost_p = new, c
        Q[i + 1], P[i + 1] = q, p
    return Q, P


def runner(kind: str, h: float, rows: int) -> Callable[[float, float, int], tuple[np.ndarray, np.ndarray]]:
    """Compile a control, one of `KINDS`, to a function (q, p, steps) -> (Q, P), arrays (rows + 1,)."""
    import numba

    if kind == PLAIN:
        run = numba.njit(plain)
        return lambda q, p, steps: run(h, steps // rows, rows, q, p)
    run, share = numba.njit(careful), float(kind == WHOLE)
    return lambda q, p, steps: run(h, share, steps // rows, rows, q, p)
