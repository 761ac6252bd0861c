"""Symplecticity and symmetry of the step maps, measured without round-off."""

from __future__ import annotations

from phasebench.benchmarks.page.markdown import listed, number, table
from phasebench.benchmarks.page.page import Page


def _write(data, figures):
    frame = data("structure")
    if frame is None:
        return None
    verdict = []
    for name, members in frame.groupby("property", sort=False):
        having, lacking = members[members["declared"]], members[~members["declared"]]
        verdict.append(
            f"{name.capitalize()}: defect at most {number(having['defect'].max())} in the {len(having)} methods (with their "
            f"parameters) declared to have it, at least {number(lacking['defect'].min())} in the {len(lacking)} others: "
            f"{listed(list(lacking['method']), 12)}."
        )
    wide = frame.pivot_table(
        index="method", columns="property", values=["declared", "defect"], aggfunc="first", sort=False
    )
    shown = wide.reset_index()
    shown.columns = [" ".join(part for part in reversed(c) if part) for c in shown.columns]
    for column in shown:
        if column.endswith("declared"):
            shown[column] = shown[column].map({True: "yes", False: "no"})
        elif column.endswith("defect"):
            shown[column] = shown[column].map(lambda x: f"{x:.1e}")
    order = ["method", *(f"{p} {c}" for p in ("symplecticity", "symmetry") for c in ("declared", "defect"))]
    body = [
        "Symplecticity: the largest entry of M^T J M - J, M the Jacobian of one step by differences. Symmetry: the distance "
        "from the start after a step and the same step backwards. Both in 40-digit arithmetic with stages solved to it, the "
        "largest over the systems (pendulum, Henon-Heiles, and non-separable ones). Schemes IV and V choose their parameter "
        "from the state, so their step maps are not symplectic; with the parameter frozen they are (tests/test_symplectic.py).\n",
        table(shown, order),
    ]
    return verdict, "\n".join(body)


PAGE = Page(
    "structure", "Symplecticity and symmetry", "what the step maps preserve, without round-off", ("structure",), _write
)
