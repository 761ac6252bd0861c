"""The audit of the established integrators, with methods of this project as controls.

It fails if a control does not come out as declared.  A contradicted claim of a package is a finding on the page, not a
failure.
"""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.audit import modes, page
from phasebench.benchmarks.experiments.audit.audit import CONTROLS, cells  # noqa: F401
from phasebench.benchmarks.experiments.audit.claims import PROPERTIES
from phasebench.benchmarks.judge.verdict import HOLDS


def off(rows: list[dict], claims: list[dict]) -> list[str]:
    """List a line for each property that a control (a method of this project) declares and its measurement contradicts.

    ``rows`` and ``claims`` are the rows of the tables "audit" and "audit_claims".
    """
    measured = {(r["peer"], r["measure"]) for r in rows}
    return [
        f"{c['peer']}: {c['claim']} {c['verdict']}: {c['measured']} {c['reason']}"
        for c in claims
        if c["peer"] in CONTROLS and c["verdict"] != HOLDS and (c["peer"], PROPERTIES[c["property"]][0]) in measured
    ]


def bench_audit(measured_rows: Callable[[str], list[dict]], complete: Callable[[str], bool]) -> None:
    """Check that at least one peer (an integrator of another package) could be imported and measured.

    ``measured_rows`` and ``complete`` are fixtures: table name -> its rows, and table name -> whether this run measured
    all of them.  If it did not, the check passes whatever the rows are.
    """
    rows = measured_rows("audit")
    audited = [r for r in rows if r["measure"] == "package" and r["status"] == "ok"]
    assert audited or not complete("audit"), "no peer could be audited"


def bench_audit_controls(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that the measurements confirm everything that the controls, methods of this project, declare."""
    wrong = off(measured_rows("audit"), measured_rows("audit_claims"))
    assert not wrong, "\n".join(wrong)


def bench_audit_modes(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that the controls, methods of this project, leave the process's floating-point mode as they found it."""
    rows = [r for r in measured_rows(modes.TABLE) if r["package"] == page.OWN and r["status"] == "ok"]
    changed = [r["peer"] for r in rows if r["mode"] != modes.KEPT]
    assert not changed, ", ".join(changed)
