"""How a step behaves as a function: whether it runs, has memory, changes its input; and its stability."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from phasebench.benchmarks.measure import linear_stability
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision

from .battery import Entry, oscillator
from .stepping import DIGITS, StepFailed, Stepper, numerical_failures
from .structure import SMOOTH, smooth
from .subject import Subject

#: Number and length of the steps of a first run.
TAKEN, H = 12, 0.125
#: Calls after which it is seen whether what the first returned is still the same.
LATER = 4
#: Steps on each of two systems that are stepped alternately.
TURNS = 5
#: Points of a line and their distance; the fourth difference that errors of 1 make at random.
POINTS, CLOSE, SPREAD = 16, 1e-6, 70**0.5
#: The stability of a step with more evaluations than this is measured only if it is claimed.
DEAR = 200
#: The determinant of an area-preserving map is 1 up to this.
AREA = 1e-12


def runs(subject: Subject, entries: list[Entry], seed: int) -> list[dict]:
    """Take a few steps on each system: a row for each, with ``status`` and ``reason``, and evaluations per step."""
    rows = []
    for entry in entries:
        stepper = Stepper(subject, entry)
        row: dict = {"on": entry.name, "status": "ok", "reason": ""}
        try:
            states = stepper.run(entry.start(seed), H * entry.unit, TAKEN)
            if len(states) <= TAKEN:
                row |= {"status": "diverged", "reason": f"after {len(states)} steps the state was not finite"}
            row |= {"dH_dq": stepper.system.evaluations[0] / TAKEN, "dH_dp": stepper.system.evaluations[1] / TAKEN}
        except StepFailed as failure:
            swapped = "; a step is called (system, q, p, h)" if failure.mistaken else ""
            row |= {"status": "raised", "reason": f"{failure}{swapped}"}
        rows.append(row)
    return rows


def state_between_steps(subject: Subject, entries: list[Entry], seed: int) -> list[dict]:
    """How much a step's results change when it is called again, or in turns with steps on another system."""
    rows = []
    for entry in entries:
        stepper, y = Stepper(subject, entry), entry.start(seed)
        h = H * entry.unit
        once = stepper.advance(y, h)
        stepper(once, h)
        rows.append({"on": entry.name, "what": "the same step twice", "value": _distance(stepper.advance(y, h), once)})
    pairs = list(combinations(entries, 2))[:3] or [(entries[0], entries[0])]
    for a, b in pairs:
        steppers = [Stepper(subject, x) for x in (a, b)]
        alone = [s.run(x.start(seed), H * x.unit, TURNS)[-1] for s, x in zip(steppers, (a, b), strict=True)]
        y = [a.start(seed), b.start(seed + (a is b))]
        if a is b:
            alone[1] = steppers[1].run(y[1], H * b.unit, TURNS)[-1]
        for _ in range(TURNS):
            y = [s.advance(x, H * s.entry.unit) for s, x in zip(steppers, y, strict=True)]
        away = max(_distance(x, z) for x, z in zip(y, alone, strict=True))
        rows.append({"on": f"{a.name} and {b.name}", "what": "steps in turns", "value": away})
    return rows


def _distance(x: np.ndarray, y: np.ndarray) -> float:
    return 0.0 if np.array_equal(x, y, equal_nan=True) else float(np.nan_to_num(np.abs(x - y).max(), nan=np.inf))


def input_changed(subject: Subject, entries: list[Entry], seed: int) -> list[dict]:
    """How much a step changes the q and p it is given, and (``later``) those that an earlier call returned."""
    rows = []
    for entry in entries:
        stepper, y = Stepper(subject, entry), entry.start(seed)
        d = len(y) // 2
        q, p = y[:d].copy(), y[d:].copy()
        first = stepper.raw(q, p, H * entry.unit)
        changed = max(_distance(q, y[:d]), _distance(p, y[d:]))
        try:
            kept = [np.array(x, dtype=float) for x in first]
            for k in range(1, LATER + 1):
                stepper(y * (1 + 0.01 * k), H * entry.unit)
            later = max(_distance(np.asarray(x, dtype=float), z) for x, z in zip(first, kept, strict=True))
        except (TypeError, ValueError):
            later = 0.0
        rows.append({"on": entry.name, "value": changed, "later": later})
    return rows


def rounding(subject: Subject, entries: list[Entry], seed: int) -> list[dict]:
    """Round-off of a step in doubles, relative to the state, on each system.

    The step is taken from states on a short line, on which a smooth map has fourth differences far below round-off.
    """
    rows = []
    for entry in entries:
        stepper, y = Stepper(subject, entry), entry.start(seed)
        way = np.random.default_rng([8, *entry.name.encode()]).uniform(0.5, 1.0, len(y)) * entry.sizes
        try:
            ends = np.array([stepper(y + k * CLOSE * way, H * entry.unit) for k in range(POINTS)]) / entry.sizes
        except StepFailed:
            continue
        scatter = np.abs(np.diff(ends, 4, axis=0)).max() / SPREAD / np.abs(ends).max()
        rows.append({"on": entry.name, "value": float(scatter)})
    return rows


def arithmetic(subject: Subject, entries: list[Entry], seed: int) -> str:
    """Return why a step cannot be measured in numbers of `DIGITS` decimal digits; "" if it can."""
    for entry in entries:
        try:
            with precision(DIGITS):
                rough = smooth(Stepper(subject, entry, MULTIPRECISION), seed)
        except StepFailed as failure:
            if not failure.place:
                return str(failure)
            return f"{failure.place} does not accept numbers of {DIGITS} digits, only doubles"
        if not rough < SMOOTH:
            return f"its steps are rough by {rough:.0e} inside"
    return ""


def stability(subject: Subject) -> dict:
    """Measure the linear stability limit, in h omega, on the harmonic oscillator; a row with only a ``reason`` if none.

    ``intervals`` are the stable ones up to ``scanned``, ``radius`` pairs (h omega, spectral radius of the step).
    """
    try:
        return _stability(subject)
    except StepFailed as failure:
        if "stability" in subject.own.claims and not failure.numerical:
            raise
        return {"on": oscillator().name, "reason": str(failure)}


def _stability(subject: Subject) -> dict:
    entry = oscillator()
    stepper = Stepper(subject, entry)
    stepper(stepper.state((1.0, 0.0)), 1.0)
    if "stability" not in subject.own.claims and sum(stepper.system.evaluations) > DEAR:
        return {"on": entry.name, "reason": f"not measured: more than {DEAR} evaluations a step, and not claimed"}

    def matrix(z: float, steps: int = 1) -> np.ndarray | None:
        columns: list[np.ndarray] = []
        with numerical_failures():
            columns = [stepper.run(unit, z, steps, every=steps) for unit in ((1.0, 0.0), (0.0, 1.0))]
        return np.array([c[-1] for c in columns]).T if [len(c) for c in columns] == [2, 2] else None

    one, two = matrix(0.5), matrix(0.5, 2)
    if one is None or two is None or not linear_stability.is_square(one, two):
        return {"on": entry.name, "reason": "a step is no matrix here: two are not one taken twice"}
    found = linear_stability.stability(matrix)
    if found.limit == 0 and abs(np.linalg.det(one) - 1) < AREA:
        # The map preserves area, so small steps are stable: its solver fails at larger ones.
        z = next((z for z in np.arange(0.05, 10, 0.05) if not _keeps(matrix(z))), 10.0)
        return {"on": entry.name, "reason": f"from h omega = {z:.2f} its own solver does not converge"}
    row = {"on": entry.name, "limit": found.limit, "scanned": found.scanned, "reason": ""}
    trace = [(z, matrix(z)) for z in np.linspace(0.05, min(found.scanned, 6.0), 60)]
    curve = [(float(z), linear_stability.radius(M)) for z, M in trace if M is not None]
    return row | {"intervals": [list(pair) for pair in found.intervals], "radius": curve}


def _keeps(M: np.ndarray | None) -> bool:
    return M is not None and abs(np.linalg.det(M) - 1) < AREA
