"""Conservation over a long run: error and drift of the energy and another invariant, and how round-off adds up.

Round-off is measured if the step accepts many digits: on each of a number of steps, as the energy after the step in
doubles less that after the same step in 40 digits, in units of eps times the energy.  If the mean over the steps is not
zero, the energy error grows as t; if it is zero, as the square root of t (Brouwer's law).
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.judge.evidence import EPS
from phasebench.benchmarks.measure.conservation import conservation, energy
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision
from phasebench.integrators.systems.formula import parse

from .battery import Entry
from .stepping import DIGITS, StepFailed, Stepper
from .subject import Subject

#: Steps of a long run, the longest step, and how often it is halved if the run breaks off.
STEPS, H, HALVED = 2400, 0.2, 3
#: The most evaluations of a gradient in a run, and the fewest steps.
EVALUATIONS, LEAST = 40_000, 400
#: Number and length (dyadic) of the steps whose round-off is measured.
ROUNDED = 256
H_ROUND = 0.125
#: A mean of more than this many standard errors is not zero.
SURE = 4.0


def long_run(subject: Subject, entry: Entry, seed: int) -> dict:
    """Make a long run on a system: a row with errors and drifts of the energy and of the system's invariant.

    If it breaks off it is repeated with half the step, up to `HALVED` times; if none lasts, its status is "diverged".
    """
    stepper, y, why = Stepper(subject, entry), entry.start(seed), "the run did not last"
    stepper.run(y, H * entry.unit / 2**HALVED, 20)
    # Counted, not timed, so that a repeated run has as many steps.
    affordable = EVALUATIONS * 20 // max(1, sum(stepper.system.evaluations))
    steps = max(LEAST, min(STEPS, affordable // LEAST * LEAST))
    for k in range(HALVED + 1):
        h = H * entry.unit / 2**k
        try:
            rows = stepper.run(y, h, steps)
        except StepFailed as failure:
            if not failure.numerical:
                raise
            why = str(failure)
            continue
        if len(rows) > steps:
            return _row(entry, rows, h, steps, subject.eps)
        why = f"after {len(rows)} steps of h = {h:g} the state was not finite"
    return {"on": entry.name, "status": "diverged", "reason": why}


def _row(entry: Entry, rows: np.ndarray, h: float, steps: int, eps: float) -> dict:
    system, d = entry.system, entry.system.d
    Q, P = rows[:, :d], rows[:, d:]
    t = h * np.arange(len(rows))
    row = {"on": entry.name, "status": "ok", "reason": "", "h": h, "steps": steps, "time": float(t[-1])}
    H = system.observe(system.H, Q, P)
    if not np.isfinite(H).all():
        n = int(np.argmax(~np.isfinite(H)))
        why = f"after {n} steps of h = {h:g} the energy was not finite"
        return {"on": entry.name, "status": "diverged", "reason": why}
    H, kept = energy(system, t, Q, P)
    taken = {"steps": steps} | ({"eps": eps} if eps > EPS else {})
    row["energy"] = kept | taken
    if entry.invariant:
        names = {str(s): s for s in (*system.q, *system.p)}
        I = system.observe(parse(entry.invariant, names), Q, P)  # noqa: E741
        row[entry.kind] = conservation(t, I, float(np.abs(I).max())) | taken
    if system.constrained:
        defects = np.concatenate(system.defects(Q, P))
        scale = float(system.rounding(Q, P).max()) / EPS
        row["constraints"] = conservation(t, np.linalg.norm(defects, axis=0), scale) | taken
    row["curve"] = [[float(x), float(e)] for x, e in zip(t[:: steps // 400], H[:: steps // 400] - H[0], strict=True)]
    return row


def round_off(subject: Subject, entry: Entry, seed: int) -> dict | None:
    """Mean and deviation of the round-off in the energy in each of `ROUNDED` steps, in eps times the energy, as a row.

    ``biased`` says whether the mean differs from zero.  None if the energy does not stay finite.
    """
    double, y = Stepper(subject, entry), entry.start(seed)
    with precision(DIGITS):
        exact = Stepper(subject, entry, MULTIPRECISION)
        H, d = exact.system.H, entry.system.d
        h, size, errors = H_ROUND * entry.unit, abs(float(H(y[:d], y[d:]))) or 1.0, []
        for _ in range(ROUNDED):
            true, y = exact(exact.state(y), h), double(y, h)
            errors.append(float(H(y[:d], y[d:]) - H(true[:d], true[d:])) / EPS / size)
    if not np.isfinite(errors).all():
        return None
    mean, deviation = float(np.mean(errors)), float(np.std(errors))
    sure = deviation / np.sqrt(len(errors)) * SURE
    return {"on": entry.name, "mean": mean, "deviation": deviation, "biased": bool(abs(mean) > sure), "steps": ROUNDED}
