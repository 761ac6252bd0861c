"""Orders of convergence, from rows of errors at several steps."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from phasebench.benchmarks.problems.scenes import ORDER
from phasebench.integrators.driver import OK

from . import metrics
from .integrator import OURS


def successive(errors: Iterable[float], floors: Iterable[float]) -> list[float]:
    """Return the observed orders log2(e_{k-1} / e_k) at halved steps; NaN for the first and below the floor."""
    found, before = [], np.nan
    for error, floor in zip(errors, floors, strict=True):
        found.append(float(np.log2(before / error)) if error > floor else np.nan)
        before = error
    return found


def orders(rows: list[dict[str, Any]], column: str = "global_error") -> list[dict[str, Any]]:
    """Measure the order of each method on each scene of the purpose "order", from rows of results at several steps.

    Only rows with status ``ok`` and a fixed step are used; ``column`` has the errors, of which those in the noise (up
    to a hundred times the reference's uncertainty or round-off) are left out.  Returns a dict for each (scene, method).
    """
    groups: dict[tuple[str, str], list[dict]] = {}
    for r in rows:
        if r["purpose"] == ORDER and r["status"] == OK and r.get(column) is not None and r["h"] is not None:
            groups.setdefault((r["scene"], r["method"]), []).append(r)
    out = []
    for (scene, label), members in groups.items():
        members.sort(key=lambda r: -r["h"])
        noise = 100 * max(np.finfo(float).eps * 4, *(r["reference_uncertainty"] for r in members))
        found = metrics.order([r["h"] for r in members], [r[column] for r in members], noise=noise)
        out.append(
            {
                "scene": scene,
                "problem": members[0]["problem"],
                "method": label,
                "kind": members[0].get("kind", OURS),
                "declared": members[0]["declared_order"],
                "order": found.value,
                "low": found.low,
                "high": found.high,
                "points": found.points,
                "h_first": found.first,
                "h_last": found.last,
            }
        )
    return out
