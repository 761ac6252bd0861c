"""Errors of single steps from states of very different sizes, since a step may be right near one size only.

For each polynomial system, states are drawn whose q and p have sizes from 1e-3 to 40, each with its own unit of time.
If a step of order p is correct, its errors fall as h^(p+1) when h is halved, and its results in doubles and in many
digits agree up to round-off.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import log2

import numpy as np

from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision, to_number

from .battery import Entry, time_unit
from .order import flow
from .stepping import DIGITS, Stepper, numerical_failures
from .subject import Subject

#: Pairs of sizes of (q, p), dealt out to the systems in turn.
SIZES = ((1e-3, 1e-3), (1.0, 5.0), (0.1, 12.0), (6.0, 1.0), (8.0, 8.0), (1e-2, 0.3), (3.0, 3.0), (0.5, 40.0))
#: How many of them each system gets.
EACH = 2
#: The steps, in the state's own unit of time.
STEPS = tuple(2.0**-k for k in range(3, 6))
#: Relative errors below this are round-off, also of coefficients and of a solver.
NOISE = 1e-13


def states(subject: Subject, entries: list[Entry], seed: int, arithmetic: str) -> list[dict]:
    """Draw states of the systems, and return a row for each: errors of single steps of h, h/2, h/4, and their order.

    ``doubles`` is how far the same step in doubles ends from the one in many digits, relative to the state's size.
    """
    able = [e for e in entries if e.system.traits["polynomial degree"] and not e.share] or [
        e for e in entries if e.share
    ]
    rows = []
    for k, entry in enumerate(able):
        for j in range(EACH):
            sizes = SIZES[(k * EACH + j) % len(SIZES)]
            rows.append(_row(subject, draw_entry(entry, sizes, seed), seed, arithmetic))
    return rows


def draw_entry(entry: Entry, sizes: tuple[float, float], seed: int) -> Entry:
    """The entry with a random state whose q and p have ``sizes``, and its unit of time; near its own if `share`."""
    rng = np.random.default_rng([4, seed, *entry.name.encode()])
    if entry.share:
        state, sizes = entry.start(seed + 1000) * (1 + 0.1 * rng.uniform(-1, 1, len(entry.state))), entry.size
        state = entry.on_manifold(state)
    else:
        state = rng.choice([-1, 1], len(entry.state)) * rng.uniform(0.6, 1.0, len(entry.state))
        state *= np.repeat(sizes, len(state) // 2)
    unit = time_unit(entry.system, state, np.repeat(sizes, len(state) // 2))
    name = f"{entry.name} with |q| = {sizes[0]:g}, |p| = {sizes[1]:g}"
    return replace(entry, name=name, state=tuple(map(float, state)), unit=unit, size=sizes, share=True)


def _row(subject: Subject, entry: Entry, seed: int, arithmetic: str) -> dict:
    stepper, errors = Stepper(subject, entry, arithmetic), []
    double = Stepper(subject, entry) if arithmetic == MULTIPRECISION else None
    noise, apart = (NOISE if double else 50 * subject.eps), 0.0
    with precision(DIGITS):
        y = entry.start(seed)
        for h in STEPS:
            error, end = _error(stepper, entry, seed, y, h * entry.unit)
            if double is not None and end is not None and h == STEPS[0]:
                apart = _distance(double, entry, y, h * entry.unit, end)
            errors.append(error)
            if error < noise:
                break
    told = [e for e in errors if noise < e < np.inf]
    slopes = [log2(a / b) - 1 for a, b in pairwise(told)]
    return {"on": entry.name, "arithmetic": arithmetic, "errors": errors, "order": max(slopes[-2:], default=None)} | {
        "pairs": len(slopes),
        "doubles": apart,
    }


def _error(stepper: Stepper, entry: Entry, seed: int, y: np.ndarray, h: float) -> tuple[float, np.ndarray | None]:
    end = None
    with numerical_failures():
        end = stepper(stepper.state(y), to_number(h, stepper.arithmetic))
    if end is None:
        return float("nan"), None
    truth = flow(entry, seed, h, 1)[0]
    if stepper.arithmetic == DOUBLE:
        truth = truth.astype(float)
    return float(np.abs(((end - truth) / entry.sizes).astype(float)).max()), end


def _distance(double: Stepper, entry: Entry, y: np.ndarray, h: float, end: np.ndarray) -> float:
    other = np.inf
    with numerical_failures():
        other = double(y, h)
    away = np.abs((other - end.astype(float)) / entry.sizes).max() / np.abs(end.astype(float) / entry.sizes).max()
    return float(away) if np.isfinite(away) else float("inf")
