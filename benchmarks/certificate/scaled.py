r"""One step in many other units: the same motion with other sizes of q, p and h, and systems side by side as one.

With :math:`Q = S q`, :math:`P = R p`, :math:`s r = S_i R_i` for all i, and :math:`t' = \tau t`, H becomes
:math:`(s r / \tau) H(Q / S, P / R)`.  A step that uses gradients alone commutes with that, and with a sum of systems
that share no coordinate.  So one known step serves to judge hundreds of others, at steps h, states and degrees of
freedom of many sizes; each costs a single call in doubles, as no reference is computed.

Where a step differs, it may be another one with the same properties, such as one with other substeps.  Its difference
from the known step is then measured at this same h with the motion slowed down by 2, 4 and 8: it falls as a power of
this factor, which is one more than the order there.  Structure is measured there, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import log2
from typing import Any

import numpy as np

from phasebench.benchmarks.judge.evidence import shows_structure
from phasebench.benchmarks.measure.own_step import System
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.systems.hamiltonian import PartitionedSystem

from .battery import Entry
from .stepping import StepFailed, Stepper
from .structure import DEFECTS, measure_defect
from .subject import Subject

#: Draws, and the most gradient evaluations that they may take together.
DRAWS, EVALUATIONS = 600, 16_000
#: Powers of 2 between which steps h, sizes of q and sizes of p are drawn.
H_POWERS, SIZE_POWERS = (-13.0, 8.0), (-3.0, 9.0)
#: Degrees of freedom: each of the first as likely as all of the last together.
FEW, MANY = tuple(range(1, 11)), (12, 16, 20, 24)
#: The step h in the units of the known step; factors by which the motion is slowed down.
H, SLOWER = 0.125, (1.0, 2.0, 4.0, 8.0)
#: Steps that differ by less than this share of the state are the same, up to a solver's tolerance; in units of the
#: step's rounding, too.
SAME, ROUNDINGS = 1e-8, 1000.0
#: How many that differ are examined; how many times the usual evaluations a step may take.
EXAMINED, HANGS = 24, 10
#: Units (h, size of q, size of p) of three steps whose median is the known one: a range of h or q cannot hold two.
KNOWN = ((1.0, 1.0, 1.0), (13.0, 0.3, 1.7), (1 / 11, 2.3, 0.6))
#: Traits of systems that have momenta in units of velocity.
UNIT_MASS = ("quadratic kinetic energy", "constant mass matrix")


class Together:
    """Systems side by side as one system, whose H is the sum of theirs."""

    constrained = False

    def __init__(self, systems: Sequence[PartitionedSystem]) -> None:
        self.systems, self.d = systems, sum(s.d for s in systems)

    def vector_field(self, arithmetic: str = DOUBLE) -> Any:
        """The function (t, y) -> y' of arrays y = (q, p) of shape (2 d,)."""
        fields, ends = [s.vector_field(arithmetic) for s in self.systems], np.cumsum([0, *(s.d for s in self.systems)])

        def f(t: float, y: np.ndarray) -> np.ndarray:
            at = [np.r_[a:b, self.d + a : self.d + b] for a, b in pairwise(ends)]
            out = np.empty_like(y)
            for part, one in zip(at, fields, strict=True):
                out[part] = one(t, y[part])
            return out

        return f


class InUnits:
    """The argument ``system`` of a step in other units (doubles); it raises after ``most`` evaluations."""

    def __init__(self, entries: Sequence[Entry], Q: np.ndarray, P: np.ndarray, tau: float) -> None:
        systems = [e.system for e in entries]
        self._inner = System(systems[0] if len(systems) == 1 else Together(systems))
        self._parts, self._Q, self._P, self._tau = [System(s) for s in systems], Q, P, tau
        self.d, self.evaluations, self.most = self._inner.d, self._inner.evaluations, float("inf")

    def _state(self, q: Any, p: Any) -> tuple[np.ndarray, np.ndarray]:
        if sum(self.evaluations) > self.most:
            raise ArithmeticError("the step does not end")
        return np.asarray(q) / self._Q, np.asarray(p) / self._P

    def dH_dq(self, q: Any, p: Any) -> np.ndarray:
        """The gradient of H by q, array (d,)."""
        return self._P / self._tau * self._inner.dH_dq(*self._state(q, p))

    def dH_dp(self, q: Any, p: Any) -> np.ndarray:
        """The gradient of H by p, array (d,)."""
        return self._Q / self._tau * self._inner.dH_dp(*self._state(q, p))

    def H(self, q: Any, p: Any) -> float:
        """The energy at q, p."""
        q, p = self._state(q, p)
        ends = np.cumsum([0, *(s.d for s in self._parts)])
        whole = sum(s.H(q[a:b], p[a:b]) for s, (a, b) in zip(self._parts, pairwise(ends), strict=True))
        return float(self._Q[0] * self._P[0] / self._tau * whole)


@dataclass(frozen=True)
class Units:
    """Units of a draw: systems side by side, the unit of time ``tau``, and signed sizes ``Q``, ``P`` of q, p, (d,)."""

    entries: tuple[Entry, ...]
    tau: float
    Q: np.ndarray
    P: np.ndarray

    @property
    def text(self) -> str:
        """The draw in words, as the name of a system on a certificate."""
        names = " + ".join(e.name for e in self.entries)
        if len(self.entries) > 3:
            names = f"{self.entries[0].name} and {len(self.entries) - 1} more"
        sizes = f"|q| = {abs(self.Q[0]):.2g}, |p| = {abs(self.P[0]):.2g}"
        return f"{names} (d = {len(self.Q)}, h = {H * self.tau:.2g}, {sizes})"


@dataclass
class InOtherUnits(Stepper):
    """A `Stepper` whose states and steps h are in the units of the battery, and those of its calls in `Units`."""

    units: Units = field(kw_only=True)

    def __post_init__(self) -> None:
        self.system = InUnits(self.units.entries, self.units.Q, self.units.P, self.units.tau)

    def advance(self, y: np.ndarray, h: float) -> np.ndarray:
        """The state after one step h from y, both in the units of the battery, array (2 d,); raises StepFailed."""
        sizes = np.concatenate([self.units.Q, self.units.P])
        return super().advance(y * sizes, h * self.units.tau) / sizes


def sweep(
    subject: Subject, entries: list[Entry], seed: int, wanted: Iterable[str]
) -> tuple[list[dict], dict[str, dict], dict]:
    """Compare steps in drawn units with the known step.

    Returns (of the steps that differ the row, as of `states`, of the lowest order; structure of ``wanted`` -> a row
    where a step breaks it; the number of steps, and the ranges of h, |q|, |p| and d that were reached).
    """
    rng, same = np.random.default_rng([7, seed]), max(SAME, ROUNDINGS * subject.eps)
    try:
        known = {e.name: [_known(subject, e, seed, k) for k in SLOWER] for e in entries}
        least = _evaluations(subject, entries[0], seed)
    except StepFailed:
        return [], {}, {}
    draws = [_identity((e,)) for e in entries]
    draws += [_draw(subject, entries, rng) for _ in range(DRAWS - len(entries))]
    taken, spent, differ = [], 0, []
    for units in draws:
        away, used = _apart(subject, units, known, seed, 0, HANGS * least)
        spent += used
        if away is not None:
            taken.append(units)
            if not away < same:
                differ.append(units)
        if spent > EVALUATIONS:
            break
    rows: list[dict] = []
    broken: dict[str, dict] = {}
    for units in differ[:EXAMINED]:
        away = [_apart(subject, units, known, seed, k, HANGS * least)[0] for k in range(len(SLOWER))]
        told = [min(x, 1e300) for x in away if x is not None and not x < same / 10]
        slopes = [log2(a / b) - 1 for a, b in pairwise(told)]
        row = {"on": units.text, "arithmetic": DOUBLE, "errors": told, "order": max(slopes, default=None)}
        if len(slopes) == len(SLOWER) - 1:
            rows.append(row | {"pairs": len(slopes), "doubles": 0.0})
        for name in wanted:
            if name not in broken and (name != "reversible" or all(e.reversible for e in units.entries)):
                found = _structure(subject, units, seed, name)
                if found and shows_structure(found) is False:
                    broken[name] = found
    return sorted(rows, key=lambda r: r["order"])[:1], broken, _reached(taken)


def _identity(entries: Sequence[Entry], tau: float = 1.0, q: float = 1.0, p: float = 1.0) -> Units:
    d = sum(e.system.d for e in entries)
    return Units(tuple(entries), tau, np.full(d, q), np.full(d, p))


def _draw(subject: Subject, entries: list[Entry], rng: np.random.Generator) -> Units:
    d, chosen = int(rng.choice(MANY) if rng.uniform() < 1 / (len(FEW) + 1) else rng.choice(FEW)), []
    while d > 0:
        fitting = [e for e in entries if e.system.d <= d]
        if not fitting:
            break
        chosen.append(fitting[int(rng.integers(len(fitting)))])
        d -= chosen[-1].system.d
    chosen = chosen or [entries[int(rng.integers(len(entries)))]]
    tau, q, p = 2 ** rng.uniform(*H_POWERS) / H, *(2 ** rng.uniform(*SIZE_POWERS, 2))
    if set(subject.own.requires) & set(UNIT_MASS):
        p = q / tau
    signs = rng.choice([-1.0, 1.0], sum(e.system.d for e in chosen))
    return Units(tuple(chosen), tau, q * signs, p * signs)


def _known(subject: Subject, entry: Entry, seed: int, slower: float) -> np.ndarray:
    """The state after a step H / slower from the entry's start, by a majority of three units."""
    y, ends = entry.start(seed), []
    mass = bool(set(subject.own.requires) & set(UNIT_MASS))
    for tau, q, p in KNOWN:
        units = _identity((entry,), tau * slower, q, q / (tau * slower) if mass else p)
        ends.append(InOtherUnits(subject, entry, units=units)(y, H / slower))
    return np.median(ends, axis=0)


def _evaluations(subject: Subject, entry: Entry, seed: int) -> int:
    stepper = Stepper(subject, entry)
    stepper(entry.start(seed), H)
    return max(1, sum(stepper.system.evaluations))


def _side_by_side(entries: Sequence[Entry], states: Iterable[np.ndarray]) -> np.ndarray:
    halves = [np.split(y, 2) for y in states]
    return np.concatenate([q for q, _ in halves] + [p for _, p in halves])


def _stepper(subject: Subject, units: Units, seed: int, slower: float = 1.0) -> tuple[InOtherUnits, np.ndarray]:
    entries = units.entries
    y = _side_by_side(entries, (e.start(seed) for e in entries))
    entry = entries[0] if len(entries) == 1 else Entry(units.text, Together([e.system for e in entries]), tuple(y))
    units = Units(entries, units.tau * slower, units.Q, units.P)
    return InOtherUnits(subject, entry, units=units), y


def _apart(subject: Subject, units: Units, known: dict, seed: int, k: int, most: int) -> tuple[float | None, int]:
    """(Distance of a draw's step from the known one, None if it fails; evaluations), slowed down by SLOWER[k]."""
    stepper, y = _stepper(subject, units, seed, SLOWER[k])
    stepper.system.most = most * len(y)
    try:
        end = stepper(y, H / SLOWER[k])
    except StepFailed:
        return None, sum(stepper.system.evaluations)
    away = float(np.abs(end - _side_by_side(units.entries, (known[e.name][k] for e in units.entries))).max())
    return (away if np.isfinite(away) else np.inf), sum(stepper.system.evaluations)


def _structure(subject: Subject, units: Units, seed: int, name: str) -> dict | None:
    stepper, y = _stepper(subject, units, seed)
    try:
        value, floor = measure_defect(stepper, y, H, DEFECTS[name])
    except StepFailed:
        return None
    separable = all(e.system.separable for e in units.entries)
    row = {"on": units.text, "arithmetic": DOUBLE, "h": H * units.tau, "value": value, "floor": floor}
    return row | {"own": 0.0, "separable": separable}


def _reached(taken: Sequence[Units]) -> dict:
    if not taken:
        return {}
    ranges = {
        "h": [H * u.tau for u in taken],
        "q": [abs(u.Q[0]) * max(abs(np.array(e.state[: e.system.d])).max() for e in u.entries) for u in taken],
        "p": [abs(u.P[0]) * max(abs(np.array(e.state[e.system.d :])).max() for e in u.entries) for u in taken],
    }
    found = {name: [float(min(x)), float(max(x))] for name, x in ranges.items()}
    return {"on": "all systems", "steps": len(taken)} | found | {"d": sorted({len(u.Q) for u in taken})}
