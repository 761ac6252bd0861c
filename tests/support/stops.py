"""Run methods on an orbit that escapes, to see how runs end early: ``python stops.py`` prints JSON.

Runs with different spacings of the stored rows must end alike.

H = (p1^2 + p2^2)/2 - q1^4 + q2^2/2, where q1 escapes to infinity in finite time: implicit equations lose their
solution, explicit steps overflow.
"""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np

from phasebench.benchmarks.measure.battery import LOW_ORDER, by_label, variants
from phasebench.integrators import Hamiltonian
from phasebench.integrators.driver import integrate

H, STEPS = 0.25, 12
#: Families that take seconds for such a run without compilation.
SLOW = {"equip"}
RUNAWAY = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - x**4 + y**2/2")


def _methods() -> dict:
    """Select a few methods of each family, explicit and implicit, by label."""
    found: dict = {}
    for m in variants(lam=(Fraction(1, 3),), order=(2,)):
        if m.order <= LOW_ORDER and m.family not in SLOW and m.lacks(RUNAWAY) is None:
            found.setdefault((m.family, m.symmetric, m.requires), m)
    return by_label(list(found.values()))


ALL = _methods()


def of(label: str) -> dict:
    """{spacing of the stored rows: [status, steps taken, gradient evaluations, stored rows (q, p)]} of a method."""
    ends = {}
    with np.errstate(all="ignore"):
        for every in (1, 5, 0):
            start = {"q0": [1.0, 0.5], "p0": [1.0, 0.0]}
            s = integrate(RUNAWAY, ALL[label], h=H, steps=STEPS, save_every=every, **start)
            ends[str(every)] = [s.status, s.counts["steps"], s.counts["gradient"], np.hstack([s.q, s.p]).tolist()]
    return ends


if __name__ == "__main__":
    print(json.dumps({"result": {label: of(label) for label in ALL}}))
