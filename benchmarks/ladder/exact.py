"""Integrators that solve a problem exactly up to round-off: one step is as good as many, whatever its length."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.benchmarks.measure.integrator import Integrator

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

#: Problem -> (families or ids of our methods, integrators of REBOUND) that are exact for it.
EXACT = {
    "kepler": ({"wisdom_holman", "fcirk"}, {"whfast", "whfast512", "saba", "mercurius", "trace"}),
    "harmonic-oscillator": (
        {"gautschi", "deuflhard", "mollified-impulse", "hochbruck-lubich", "hairer-lubich", "grimm-hochbruck"},
        set(),
    ),
}
#: The remark on such an integrator.
REMARK = "exact for this problem: any step"


def exact(c: Integrator, problem: Problem) -> bool:
    """True if the integrator solves the problem exactly at any step: its cost at a given error has no meaning."""
    of_ours, of_rebound = EXACT.get(problem.id, (set(), set()))
    settings = getattr(c.record, "settings", {})
    return bool({c.id, getattr(c.record, "family", None)} & of_ours) or settings.get("integrator") in of_rebound
