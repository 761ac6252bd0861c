"""What one row tells of one property: kept, broken or open; bounded, drifting or open; agreed, differing or open.

- Structure: broken where the defect is over 100 times the floor, kept where it is not and what there is to see (the
  integrator's own error, and the classical Runge-Kutta method's defect where it was measured) is over 1000 times it;
  of a step that is validated it is open between its floor and 100 times that.
- Energy and invariants: an error that drifts has a slope whose interval leaves out 0 and whose sum is more than half
  of the greatest error; one of round-off is within Brouwer's law with a generous constant.
- Order: agreed within 0.1; differing where the whole interval is farther away and the order is within 0.1 of another
  integer (else the ladder is not asymptotic yet).
"""

from __future__ import annotations

from math import isnan, sqrt

import numpy as np

EPS = float(np.finfo(float).eps)
GATE = 0.1
#: Multiples of the floor: a defect above is none of round-off; what there is to see is above.
BROKEN, VISIBLE = 100.0, 1000.0
#: The drift's share of the greatest error above which the error drifts, and below which it is bounded.
DRIFTS, STAYS = 0.5, 0.1
#: An error of this part of the energies' size is not called bounded: a dissipated energy no longer drifts.
LARGE = 0.25
#: The energy error of round-off is at most so many units of round-off times the root of the steps.
BROUWER = 100.0


def has(row, key) -> bool:
    """Whether a row has a number there."""
    value = row.get(key)
    return value is not None and not (isinstance(value, float) and isnan(value))


def kept(row) -> bool | None:
    """Whether a row of a structure shows it; None where it cannot be told."""
    if row.get("status", "ok") != "ok" or not has(row, "floor"):
        return None
    if row["value"] > BROKEN * row["floor"]:
        return False
    return True if min(row.get("classical", row["own"]), row["own"]) > VISIBLE * row["floor"] else None


def between(row) -> bool:
    """Whether the defect of a row is above its floor, and not so far above that round-off is ruled out."""
    return has(row, "floor") and row["floor"] < row["value"] <= BROKEN * row["floor"]


def shown(row) -> bool | None:
    """As `kept`; None also for a defect that is `between`."""
    return None if between(row) else kept(row)


def bounded(row) -> bool | None:
    """Whether the error of an invariant is bounded, as far as its time tells; None where that is open."""
    if row.get("status", "ok") != "ok" or not has(row, "slope"):
        return None
    moved = abs(row["slope"]) * row["time"]
    if row["value"] > LARGE * row["scale"]:
        return False if moved > DRIFTS * row["value"] else None
    if row["low"] <= 0 <= row["high"] or moved <= STAYS * row["value"]:
        return True
    return False if moved > DRIFTS * row["value"] else None


def round_off(row) -> float:
    """What round-off may do to the energy of a row."""
    return BROUWER * EPS * row["scale"] * sqrt(row["steps"])


def agrees(row, claimed: int) -> bool | None:
    """Whether a row's order is the claimed one; None without a window, or with one too wide to tell."""
    if row.get("status", "ok") != "ok" or not has(row, "value"):
        return None
    if abs(row["value"] - claimed) < GATE:
        return True
    outside = row["low"] > claimed + GATE or row["high"] < claimed - GATE
    return False if outside and abs(row["value"] - round(row["value"])) < GATE else None
