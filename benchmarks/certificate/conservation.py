"""What a step keeps over a long run: the energy and another invariant, their drift; and what its round-off adds up to.

Round-off, where the step takes many digits: of each of some steps in doubles the energy error that is not there in 40
digits, in units of eps times the energies' size.  A mean that is not zero adds up as t, a mean of zero as the root of
t (Brouwer's law).
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.drift import drift
from phasebench.integrators.engine.codegen import MULTIPRECISION, precision
from phasebench.integrators.systems.formula import parse

from .battery import Entry
from .order import EPS, numerical
from .stepping import DIGITS, StepFailed, Stepper
from .subject import Subject

#: Steps of a long run, the longest step, and how often it is halved where the run does not last.
STEPS, H, HALVED = 2400, 0.2, 3
#: So many evaluations of a gradient may a run take, and at least so many steps.
EVALUATIONS, LEAST = 40_000, 400
#: Steps whose round-off is looked at, and how long they are (dyadic).
ROUNDED = 256
H_ROUND = 0.125
#: Multiples of the standard error of a mean that is no accident.
SURE = 4.0


def long_run(subject: Subject, entry: Entry, seed: int) -> dict:
    """A row of the energy and of the invariant along a run; its ``times`` and ``errors`` are for a figure."""
    stepper, y, why = Stepper(subject, entry), entry.start(seed), "the run did not last"
    stepper.run(y, H * entry.unit / 2**HALVED, 20)
    # Counted, not timed: a run again has as many steps.
    affordable = EVALUATIONS * 20 // max(1, sum(stepper.system.evaluations))
    steps = max(LEAST, min(STEPS, affordable // LEAST * LEAST))
    for k in range(HALVED + 1):
        h = H * entry.unit / 2**k
        try:
            rows = stepper.run(y, h, steps)
        except StepFailed as failure:
            if not numerical(failure):
                raise
            why = str(failure)
            continue
        if len(rows) > steps:
            return _row(entry, rows, h, steps)
        why = f"after {len(rows)} steps of h = {h:g} the state was not finite"
    return {"on": entry.name, "status": "diverged", "reason": why}


def _row(entry: Entry, rows, h: float, steps: int) -> dict:
    system, d = entry.system, entry.system.d
    Q, P = rows[:, :d], rows[:, d:]
    t = h * np.arange(len(rows))
    H = system.observe(system.H, Q, P)
    kinetic = sum(system.observe(e, Q, P) * P[:, i] for i, e in enumerate(system.dq))
    row = {"on": entry.name, "status": "ok", "reason": "", "h": h, "steps": steps, "time": float(t[-1])}
    row["energy"] = _kept(t, H, float(np.abs(H).max() + np.abs(kinetic).max()))
    if entry.invariant:
        names = {str(s): s for s in (*system.q, *system.p)}
        I = system.observe(parse(entry.invariant, names), Q, P)  # noqa: E741
        row[entry.kind] = _kept(t, I, float(np.abs(I).max()))
    row["curve"] = [[float(x), float(e)] for x, e in zip(t[:: steps // 400], H[:: steps // 400] - H[0], strict=True)]
    return row


def _kept(t, values, scale: float) -> dict:
    found, slope = metrics.invariant_error(values), drift(t, values - values[0])
    moved = {"slope": slope.value, "low": slope.low, "high": slope.high}
    return {"value": float(found.max), "scale": scale, "steps": len(t) - 1, "time": float(t[-1])} | moved


def round_off(subject: Subject, entry: Entry, seed: int) -> dict:
    """A row of the mean and the deviation of a step's round-off in the energy, in units of eps times its size."""
    double, y = Stepper(subject, entry), entry.start(seed)
    with precision(DIGITS):
        exact = Stepper(subject, entry, MULTIPRECISION)
        H, d = exact.system.H, entry.system.d
        h, size, errors = H_ROUND * entry.unit, abs(float(H(y[:d], y[d:]))) or 1.0, []
        for _ in range(ROUNDED):
            true, y = exact(exact.state(y), h), double(y, h)
            errors.append(float(H(y[:d], y[d:]) - H(true[:d], true[d:])) / EPS / size)
    mean, deviation = float(np.mean(errors)), float(np.std(errors))
    sure = deviation / np.sqrt(len(errors)) * SURE
    return {"on": entry.name, "mean": mean, "deviation": deviation, "biased": bool(abs(mean) > sure), "steps": ROUNDED}
