"""Tables of measurements, and what one row shows: a structure kept or broken, an error bounded or drifting, an order.

A row may be inconclusive; the functions then return None.

- Structure: broken if the defect exceeds 100 times the floor of round-off; kept if it does not and a visible effect
  (the integrator's own error, and the classical Runge-Kutta method's defect if measured) exceeds 1000 times the floor.
  In a certificate a defect between the floor and 100 times the floor is inconclusive.
- Energy and invariants: an error drifts if its slope is several half-intervals from 0 and slope times time exceeds a
  hundredth of the largest error; it is round-off if it is within Brouwer's law with a generous constant.
- Order: agrees within 0.1; differs if its whole interval is farther away and the order is within 0.1 of another
  integer (otherwise the step sizes are not yet asymptotic).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan, sqrt
from typing import Any

import numpy as np

from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF

EPS = float(np.finfo(float).eps)
GATE = 0.1
#: Multiples of the floor: a defect above `BROKEN` is not round-off; an effect above `VISIBLE` can be resolved.
BROKEN, VISIBLE = 100.0, 1000.0
#: Defects up to this, of a step map in 40 digits, come from the solver and the finite differences.
NO_DEFECT = 1e-22
#: A slope of more than so many half-intervals is not 0: the intervals of several systems may exclude it by chance.
CLEAR = 2.5
#: Share of slope times time in the largest error up to which the error is bounded.
STAYS = 0.01
#: A larger share of the size of the energy is not called bounded: an energy dissipated to the end no longer drifts.
LARGE = 0.25
#: Largest round-off error of the energy, in units of eps times the square root of the number of steps.
BROUWER = 100.0


@dataclass
class Tables:
    """The measurements of an integrator.

    Attributes
    ----------
    rows : name of a measurement, such as "order" -> its rows, mostly one for each test system
    failed : name of a measurement that failed -> the reason; "all", "raised" and "time" (time over) concern all of them
    done : names of the completed measurements
    """

    rows: dict[str, list[dict]] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    done: set[str] = field(default_factory=set)

    def of(self, name: str) -> list[dict]:
        """Return the rows of the measurement with this name; [] if it was not made."""
        return self.rows.get(name, [])


def has(row: Mapping[str, Any], key: str) -> bool:
    """True if the row has a number under the key (neither None nor NaN)."""
    value = row.get(key)
    return value is not None and not (isinstance(value, float) and isnan(value))


def keeps_structure(row: Mapping[str, Any]) -> bool | None:
    """True if a row shows a structure (such as symplecticity), False if it shows it broken, None if inconclusive.

    ``value`` is the defect; ``floor`` its round-off; ``own`` the integrator's own error; and, if measured,
    ``classical`` the defect of the classical Runge-Kutta method.
    """
    if row.get("status", "ok") != "ok" or not has(row, "floor"):
        return None
    if row["value"] > BROKEN * row["floor"]:
        return False
    return True if min(row.get("classical", row["own"]), row["own"]) > VISIBLE * row["floor"] else None


def between(row: Mapping[str, Any]) -> bool:
    """True if a row's defect is above its round-off floor, but so little that it may still be round-off."""
    return has(row, "floor") and row["floor"] < row["value"] <= BROKEN * row["floor"]


def shows_structure(row: Mapping[str, Any]) -> bool | None:
    """`keeps_structure`, but a defect that is a little above the round-off floor is inconclusive."""
    return None if between(row) else keeps_structure(row)


def is_bounded(row: Mapping[str, Any]) -> bool | None:
    """True if the error of an invariant is bounded over the time of the row, False if it drifts, None if unclear.

    ``value`` is the largest error; ``slope`` has its interval ``low``, ``high``; ``scale`` is the size of the
    invariant's terms.
    """
    if row.get("status", "ok") != "ok" or not has(row, "slope"):
        return None
    moved, half = abs(row["slope"]) * row["time"], (row["high"] - row["low"]) / 2
    small = moved <= max(STAYS * row["value"], round_off(row))
    if abs(row["slope"]) > CLEAR * half and not small:
        return False
    small |= row["low"] <= 0 <= row["high"]
    return True if small and row["value"] <= LARGE * row["scale"] else None


def round_off(row: Mapping[str, Any]) -> float:
    """Upper bound of the round-off error of an invariant in the run of a row, by Brouwer's law."""
    return BROUWER * row.get("eps", EPS) * row["scale"] * sqrt(row["steps"])


def kind(row: Mapping[str, Any]) -> str | None:
    """The kind of error of an invariant along a long run: `ROUND_OFF`, `BOUNDED`, `DRIFT`, or None if unclear."""
    if row["value"] <= round_off(row):
        return ROUND_OFF
    stays = is_bounded(row)
    return None if stays is None else BOUNDED if stays else DRIFT


def agrees(row: Mapping[str, Any], claimed: int) -> bool | None:
    """True if a row's measured order is the claimed one, False if it differs, None if the row does not decide.

    It differs if its whole interval is away from ``claimed`` and it is close to another integer.
    """
    if row.get("status", "ok") != "ok" or not has(row, "value"):
        return None
    if abs(row["value"] - claimed) < GATE:
        return True
    outside = row["low"] > claimed + GATE or row["high"] < claimed - GATE
    return False if outside and abs(row["value"] - round(row["value"])) < GATE else None
