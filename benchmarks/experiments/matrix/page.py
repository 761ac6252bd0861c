"""The matrix: every method on every problem, what was measured beside what is declared."""

from __future__ import annotations

import string

import pandas as pd

from phasebench.benchmarks.page.markdown import listed, table
from phasebench.benchmarks.page.page import Page

from . import matrix

PARTS = {
    "order": "Order",
    "symplecticity": "Symplecticity defect",
    "reversibility": "Reversibility defect",
    "energy": "Energy error, relative to its terms",
    "quadratic": "Error of the invariants of the form q.D p, relative to their terms",
}
DECLARED = {
    "order": ("declared", lambda r: str(r["declared_order"])),
    "symplecticity": ("symplectic", lambda r: "yes" if r["symplectic"] else "no"),
    "reversibility": ("symmetric", lambda r: "yes" if r["symmetric"] else "no"),
    "energy": ("declared", lambda r: r["energy_class"]),
    "quadratic": ("declared", lambda r: r["quadratic_class"]),
}


def _order(r) -> str:
    if pd.isna(r["order"]):
        return "no window"
    half = (r["high"] - r["low"]) / 2
    return f"{r['order']:.2f}" if half < 0.005 else f"{r['order']:.2f} +- {half:.2f}"


class Reasons:
    """A letter for each reason why a cell has no number."""

    def __init__(self):
        self.letters: dict[str, str] = {}

    def __call__(self, reason: str) -> str:
        """The reason's letter in parentheses."""
        if reason not in self.letters:
            n = len(self.letters)
            self.letters[reason] = string.ascii_lowercase[n % 26] * (1 + n // 26)
        return f"({self.letters[reason]})"

    def legend(self) -> str:
        """The letters and what they stand for."""
        return "; ".join(f"({letter}) {reason}" for reason, letter in self.letters.items())


def _text(r, part: str, reasons: Reasons) -> str:
    for reason in (r.get("reason"), r.get(f"{part}_reason")):
        if isinstance(reason, str):
            return reasons(reason)
    return _order(r) if part == "order" else f"{r[part]:.0e}"


def _part(frame, part: str, reasons: Reasons) -> str:
    head, declared = DECLARED[part]
    lines = []
    for method, members in frame.groupby("method", sort=False):
        first = members.iloc[0]
        cells = {r["problem"]: _text(r, part, reasons) for _, r in members.iterrows()}
        lines.append({"method": method, head: declared(first)} | cells)
    return table(pd.DataFrame(lines).fillna("missing"))


def _write(data, figures):
    frame = data("matrix")
    if frame is None:
        return None
    frame = frame.astype(object).where(frame.notna(), None)
    rows = frame.to_dict("records")
    for r in rows:
        r["reason"] = r.get("reason")
    run = [r for r in rows if r["reason"] is None]
    wrong = [(r, c) for r in run for c in matrix.contradictions(r)]
    higher = [r for r in run if r.get("order") is not None and r["order"] > r["declared_order"] + 0.1]
    methods, problems = frame["method"].nunique(), frame["problem"].nunique()
    unexplained = [f"{r['method']} on {r['problem']}: {c}" for r, c in wrong if not matrix.explanation(r, c)]
    verdict = [
        f"{methods} methods on {problems} problems: {len(run)} pairs run, in {len(rows) - len(run)} the problem lacks what "
        "the method requires; no pair is missing.",
        f"{len(wrong)} cells fall short of their declaration; {len(wrong) - len(unexplained)} of these are explained below"
        + (f", the others: {listed(unexplained)}." if unexplained else "."),
        f"On {len(higher)} pairs the order is higher than declared (linear problems, and where leading terms vanish).",
    ]
    body = [
        "Order, symplecticity and reversibility without round-off; the energy's error in doubles over a short run. A number "
        "is what was measured, a letter says why there is none. Lattices are measured with four points.\n"
    ]
    reasons = Reasons()
    tables = {part: _part(frame.astype(object).where(frame.notna(), None), part, reasons) for part in PARTS}
    body.append(f"{reasons.legend()}.\n")
    for part, title in PARTS.items():
        body += [f"## {title}\n", tables[part]]
    body += ["## Explained\n"]
    for text in dict.fromkeys(matrix.explanation(r, c) for r, c in wrong if matrix.explanation(r, c)):
        cells = [f"{r['method']} on {r['problem']} ({c})" for r, c in wrong if matrix.explanation(r, c) == text]
        body.append(f"- {text}: {listed(cells, 40)}.")
    if not wrong:
        body.append("Nothing had to be.")
    body.append("\n## Order above the declared one\n")
    body.append(listed([f"{r['method']} on {r['problem']}: {r['order']:.2f}" for r in higher], 1000) + ".")
    return verdict, "\n".join(body)


PAGE = Page(
    "matrix",
    "Every method on every problem",
    "order and defects of all pairs, beside what is declared",
    ("matrix",),
    _write,
)
