"""The table row on certified reference states measured again, for `phasebench.certify` and for the report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.reference.certificates.check import Outcome

if TYPE_CHECKING:
    from phasebench.reference.certificates.stored import Check, End


def row(outcome: Outcome) -> dict[str, object]:
    """Make the table row on an orbit whose reference states were measured again.

    It has errors and uncertainties, the horizon (the time up to which rounding to long double stays small), distances
    of other solvers, and the statements that are not confirmed.
    """
    known, ratios = outcome.certificate, outcome.ratios
    last = known.ends[-1]
    first = last.checks[0]
    checks = [(e, c) for e in known.ends for c in e.checks]
    return {
        "problem": known.problem,
        "t_end": known.t_end,
        "states": len(known.ends),
        "limit": known.limit,
        "error": outcome.errors[-1],
        "uncertainty": last.uncertainty,
        "least bound": min(ratios),
        "largest bound": max(ratios),
        "long double": outcome.long_double,
        "horizon": known.horizon,
        "earliest": known.earliest,
        "latest": known.latest,
        "long double leaves": outcome.leaves,
        "digits hold to the end": known.digits_horizon == known.t_end,
        "growth": outcome.growth,
        "rate": outcome.rate,
        "energy": max(abs(e.energy) for e in known.ends),
        "second solver": first.solver,
        "distance": first.distance,
        "its uncertainty": first.uncertainty,
        "other solvers": ", ".join(_format_check(last, c) for c in last.checks[1:]),
        "disagree": outcome.disagree,
        "pairs": sum(e.compares(c) for e, c in checks),
        "no comparison": sum(not e.compares(c) for e, c in checks),
        "unchecked": sum(not any(e.compares(c) for c in e.checks) for e in known.ends),
        "changed": "; ".join(outcome.wrong),
    }


def _format_check(end: End, check: Check) -> str:
    text = f"{check.solver}: {check.distance:.2g} (own {check.uncertainty:.2g})"
    return text if end.compares(check) else f"{text}, no comparison"
