"""The audit of the established integrators, with methods of this project as controls.

It fails where a control does not come out as declared, not where a package's claim is: that is a finding, and the page
says so.
"""

from __future__ import annotations

from phasebench.benchmarks.experiments.audit import judge, modes, page
from phasebench.benchmarks.experiments.audit.audit import CONTROLS, cells  # noqa: F401

#: A claim's property, and the measure that judges it.
PROPERTIES = {"order": "order", "symplectic": "symplecticity", "reversible": "reversibility", "energy": "energy"}


def off(rows, claims) -> list[str]:
    """The declarations of controls that do not come out as they are proved."""
    measured = {(r["peer"], r["measure"]) for r in rows}
    return [
        f"{c['peer']}: {c['claim']} {c['verdict']}: {c['measured']} {c['reason']}"
        for c in claims
        if c["peer"] in CONTROLS and c["verdict"] != judge.HOLDS and (c["peer"], PROPERTIES[c["property"]]) in measured
    ]


def bench_audit(measured, complete):
    """Every peer whose package can be imported is measured."""
    rows = measured("audit")
    audited = [r for r in rows if r["measure"] == "package" and r["status"] == "ok"]
    assert audited or not complete("audit"), "no peer could be audited"


def bench_audit_controls(measured):
    """The controls' declarations hold."""
    wrong = off(measured("audit"), measured("audit_claims"))
    assert not wrong, "\n".join(wrong)


def bench_audit_modes(measured):
    """The controls leave the process's floating-point mode as they found it."""
    rows = [r for r in measured(modes.TABLE) if r["package"] == page.OWN and r["status"] == "ok"]
    changed = [r["peer"] for r in rows if r["mode"] != modes.KEPT]
    assert not changed, ", ".join(changed)
