"""The audit of the established integrators, with methods of this project as controls.

It fails where a control does not come out as declared or a false label is not contradicted, not where a package's
claim is: that is a finding, and the page says so.
"""

from __future__ import annotations

from dataclasses import replace

from phasebench.benchmarks.experiments.audit import judge
from phasebench.benchmarks.experiments.audit.audit import audit
from phasebench.benchmarks.experiments.audit.controls import CONTROLS, control

QUICK = ("rebound-leapfrog", "scipy-dop853", "heyoka")


def bench_audit(results, quick):
    """Every peer whose package can be imported; two measures of three peers in the quick tier."""
    found = audit(QUICK if quick else None, quick=quick, isolate=not quick)
    results.add("audit", found.rows)
    results.add("audit_claims", found.claims)
    audited = [r for r in found.rows if r["measure"] == "package" and r["status"] == "ok"]
    assert audited, "no peer could be audited"


def bench_audit_controls(results, quick):
    """The controls' declarations hold; the same method under a false label is contradicted."""
    found = audit(CONTROLS[:2] if quick else CONTROLS, quick=quick, isolate=False)
    results.add("audit", found.rows)
    results.add("audit_claims", found.claims)
    measured = {r["measure"] for r in found.rows}
    properties = {"order": "order", "symplectic": "symplecticity", "reversible": "reversibility", "energy": "energy"}
    wrong = [
        f"{c['peer']}: {c['claim']} {c['verdict']}: {c['measured']} {c['reason']}"
        for c in found.claims
        if c["verdict"] != judge.HOLDS and properties[c["property"]] in measured
    ]
    assert not wrong, "\n".join(wrong)
    rk4 = control("rk4")
    label = replace(rk4, id="rk4-mislabelled", claims=replace(rk4.claims, symplectic=True))
    assert audit([label], quick=True).contradictions, "rk4 passes for symplectic: the audit can see nothing"
