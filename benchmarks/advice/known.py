"""What is true of what is asked for, and whether it can tell the accuracy."""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE, Truth
from phasebench.reference.certificates import horizon, stored
from phasebench.reference.solvers.taylor import ReferenceFailed

from .ask import Ask

#: How many times the rounding of long double that of double is.
DOUBLE = 2.0**11
#: What is true has to be known to this share of the accuracy, and to this one of the state's size.
KNOWN, SIZE = 0.25, 0.01
#: An accuracy above this share of the state's size asks for nothing.
NOTHING = 0.5


def known(ask: Ask) -> tuple[Truth | None, str]:
    """(what is true, why it cannot tell the accuracy that is asked for)."""
    try:
        true = truths.truth(ask.problem, ask.quantity, ask.t_end)
    except ReferenceFailed as error:
        return None, f"there is no reference: {error}"
    size = float(np.abs(true.values).max())
    if ask.quantity.kept:
        return true, ""
    rounding = _rounding(ask, true)
    if ask.accuracy is not None and rounding > horizon.LIMIT * size and DOUBLE * rounding > ask.accuracy:
        grown = f"the rounding of doubles grows to about {DOUBLE * rounding:.1g} by then"
        return true, f"the orbit is past its horizon: {grown}; {_lost(ask, ask.accuracy)}"
    if not true.uncertainty <= SIZE * max(size, 1e-300):
        return true, f"references in long double part before t = {ask.t_end:g}; {_lost(ask, SIZE * size)}"
    if ask.accuracy is not None and true.uncertainty > KNOWN * ask.accuracy:
        known = f"the reference itself is known to {true.uncertainty:.2g}"
        return true, f"{known}, not to a quarter of {ask.accuracy:g}; {_lost(ask, ask.accuracy)}"
    if ask.accuracy is not None and ask.accuracy > NOTHING * size and not ask.quantity.angle:
        return (
            true,
            f"an error of {ask.accuracy:g} is allowed, and the quantity itself is {size:.2g}: anything meets it",
        )
    return true, ""


def _rounding(ask: Ask, true: Truth) -> float:
    """What rounding to long double makes of the quantity; 0 where nearby orbits have the same, or another, anyway."""
    if ask.quantity.statistical:
        return 0.0
    if true.source == truths.CERTIFIED:
        return stored.end(ask.problem, ask.t_end).long_double
    return true.uncertainty / truths.SAFETY


def _lost(ask: Ask, accuracy: float) -> str:
    """Until when the orbit can be followed to an accuracy."""
    t = ask.t_end
    for _ in range(12):
        t /= 2
        try:
            if truths.truth(ask.problem, END_STATE, t).uncertainty * DOUBLE <= accuracy:
                break
        except ReferenceFailed:
            continue
    else:
        t = 0.0
    reached = f"doubles follow it to about t = {t:.2g}" if t else "doubles cannot follow it"
    return f"to {accuracy:.1g} {reached}: ask for a shorter span, or for the energy (--quantity energy)"
