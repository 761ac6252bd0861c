"""Who is exact on a problem but for rounding: one step is as good as many, whatever its length."""

from __future__ import annotations

from phasebench.benchmarks.measure.integrator import Integrator

#: Problem -> families or methods of ours, and integrators of REBOUND.
EXACT = {
    "kepler": ({"wisdom_holman"}, {"whfast", "whfast512", "saba", "mercurius", "trace"}),
    "harmonic-oscillator": (
        {"gautschi", "deuflhard", "mollified-impulse", "hochbruck-lubich", "hairer-lubich", "grimm-hochbruck"},
        set(),
    ),
}
#: What is said of one.
REMARK = "exact for this problem: any step"


def exact(c: Integrator, problem) -> bool:
    """Whether there is nothing to integrate for it, so that what it costs is no price of an accuracy."""
    of_ours, of_rebound = EXACT.get(problem.id, (set(), set()))
    settings = getattr(c.record, "settings", {})
    return bool({c.id, getattr(c.record, "family", None)} & of_ours) or settings.get("integrator") in of_rebound
