"""The true value of the quantity of a question, and whether it is known well enough to judge the accuracy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.reference.certificates import horizon, stored
from phasebench.reference.solvers.taylor import ReferenceFailed
from phasebench.reference.solvers.watch import TooLong

from .ask import Ask

#: Unit round-off of double over that of long double.
DOUBLE = 2.0**11
#: The largest uncertainty of the true value, as a share of the accuracy and of the quantity's size.
KNOWN, SIZE = 0.25, 0.01
#: The time until which it is known is searched from span / 2^HALVINGS upwards, and bisected to the factor NEAR.
HALVINGS, NEAR = 12, 1.01
#: An accuracy above this share of the quantity's size requires nothing.
NOTHING = 0.5


def true_value(ask: Ask) -> tuple[Truth | None, str]:
    """The true value of the quantity of a question (None without a reference), and why it cannot judge the accuracy."""
    try:
        true = truths.truth(ask.problem, ask.quantity, ask.t_end)
    except ReferenceFailed as error:
        return None, f"there is no reference: {error}"
    size = float(np.abs(true.values).max())
    why = doubt(ask, true)
    if why:
        try:
            why = f"{why}; {_until(ask)}"
        except TooLong:
            why = f"{why}; the time limit ended before it was found to which time it is known"
        return true, f"{why}: ask for a shorter span, or for the energy (--quantity energy)"
    if ask.quantity.kept:
        return true, ""
    if ask.accuracy is not None and ask.accuracy > NOTHING * size and not ask.quantity.angle:
        return (
            true,
            f"an error of {ask.accuracy:g} is allowed, and the quantity itself is {size:.2g}: anything meets it",
        )
    return true, ""


def doubt(ask: Ask, true: Truth) -> str:
    """Why the true value is not known well enough for the accuracy; "" if it is."""
    if ask.quantity.kept:
        return ""
    size, rounding = float(np.abs(true.values).max()), _rounding(ask, true)
    if ask.accuracy is not None and rounding > horizon.LIMIT * size and DOUBLE * rounding > ask.accuracy:
        return f"the orbit is past its horizon: the rounding of doubles grows to about {DOUBLE * rounding:.1g} by then"
    if not true.uncertainty <= SIZE * max(size, 1e-300):
        return f"references in long double part before t = {ask.t_end:g}"
    if ask.accuracy is not None and true.uncertainty > KNOWN * ask.accuracy:
        return f"the reference itself is known to {true.uncertainty:.2g}, not to a quarter of {ask.accuracy:g}"
    return ""


def _rounding(ask: Ask, true: Truth) -> float:
    if ask.quantity.statistical:
        return 0.0
    if true.source == truths.CERTIFIED:
        return stored.end(ask.problem, ask.t_end).long_double
    return true.rounding


def _until(ask: Ask) -> str:
    """A clause that says until which time the quantity is known well enough, found by bisection and rounded down."""
    sign, good, bad = np.sign(ask.t_end), 0.0, abs(ask.t_end)
    t = bad / 2**HALVINGS
    for _ in range(2 * HALVINGS):
        good, bad = (t, bad) if _holds(ask, sign * t) else (good, t)
        if good == 0.0 or bad <= NEAR * good:
            break
        t = min(2 * good, (good + bad) / 2)
    if not good:
        return "doubles cannot follow it"
    unit = 10.0 ** (np.floor(np.log10(good)) - 2)
    down = float(f"{np.floor(good / unit) * unit:.3g}")
    return f"to {ask.accuracy or SIZE:.1g} it is known to t = {sign * down:g}"


def _holds(ask: Ask, t: float) -> bool:
    try:
        return not doubt(replace(ask, t_end=t), truths.truth(ask.problem, ask.quantity, t))
    except ReferenceFailed:
        return False
