"""The row of a certified reference that was computed anew, in the command's table and in the report."""

from __future__ import annotations

from phasebench.reference.certificates.check import Outcome


def row(outcome: Outcome) -> dict[str, object]:
    """How exact a reference is at its last time, how far it reaches, what other solvers say and whether it moved."""
    new = outcome.fresh
    last = new.ends[-1]
    first = last.checks[0]
    return {
        "problem": new.problem,
        "t_end": new.t_end,
        "states": len(new.ends),
        "limit": new.limit,
        "uncertainty": last.uncertainty,
        "long double": last.long_double,
        "horizon": new.horizon,
        "holds to the end": new.horizon == new.t_end,
        "digits hold to the end": new.digits_horizon == new.t_end,
        "growth": new.growth,
        "rate": new.rate,
        "energy": max(abs(e.energy) for e in new.ends),
        "second solver": first.solver,
        "distance": first.distance,
        "its uncertainty": first.uncertainty,
        "other solvers": ", ".join(f"{c.solver}: {c.distance:.2g} (own {c.uncertainty:.2g})" for c in last.checks[1:]),
        "disagree": outcome.disagree,
        "pairs": sum(len(e.checks) for e in new.ends),
        "moved by": outcome.moved,
        "allowed": outcome.allowed,
        "changed": outcome.changed,
    }
