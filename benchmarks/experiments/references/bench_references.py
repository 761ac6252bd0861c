"""The certified references computed anew: a run fails where a stored state moved or solvers disagree."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.references.rows import row
from phasebench.benchmarks.problems import labels, problem
from phasebench.reference.certificates import check

#: What the quick tier computes: one regular, one chaotic, one that is no canonical system.
QUICK = ("pendulum:swinging", "henon-heiles:chaotic", "lotka-volterra:4-2")


@pytest.mark.parametrize("label", labels())
def bench_reference(label, results, quick):
    """Nothing moved beyond its uncertainty, and every solver agrees."""
    if quick and label not in QUICK:
        pytest.skip("the full run computes it")
    outcome = check.renew(problem(label))
    results.add("references", [row(outcome)])
    assert not outcome.changed, f"{label}: {outcome.changed}; phasebench certify {label} shows it"
    assert all(end.agree for end in outcome.fresh.ends), [end.checks for end in outcome.fresh.ends]
    assert outcome.fresh.digits_horizon == outcome.fresh.t_end, "the stored digits do not hold to the end: end sooner"
