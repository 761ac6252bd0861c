"""The Kepler comparison: error against time beside the established integrators."""

from __future__ import annotations

from ..figures import rows as drawings
from ..markdown import number, table
from .page import Page

WANTED = (1e-3, 1e-6, 1e-9)


def _write(data, figures):
    frame = data("peers")
    if frame is None:
        return None
    ok = frame[frame["status"] == "ok"]
    verdict = []
    body = [
        "Error in the maximum norm over (q, p) at the end, an apocentre, against a certified Taylor solution; seconds of the "
        "warm integration alone, without output (median). heyoka and REBOUND are compiled; SciPy's right-hand side is "
        "Python, which is most of its time. WHFast and its relatives solve the unperturbed Kepler problem exactly, so there "
        "they show round-off only.\n"
    ]
    for problem, members in ok.groupby("problem", sort=False):
        parts = []
        for wanted in WANTED:
            enough = members[members["error"] <= wanted]
            if enough.empty:
                parts.append(f"{wanted:g}: none")
                continue
            best = enough.loc[enough["seconds"].idxmin()]
            ours = enough[enough["kind"] == "phasebench"]
            text = f"{wanted:g}: {best['method']} ({best['setting']}, {best['seconds'] * 1e3:.3g} ms)"
            if best["kind"] != "phasebench" and len(ours):
                mine = ours.loc[ours["seconds"].idxmin()]
                text += f", of this project {mine['method']} ({mine['setting']}, {mine['seconds'] * 1e3:.3g} ms)"
            parts.append(text)
        verdict.append(f"{problem}, cheapest that ends with an error under " + "; ".join(parts) + ".")
        name = drawings.work_precision(members, problem, figures)
        body += [f"## {problem}\n", f"![work-precision diagram of {problem}](figures/{name})\n"]
        everything = frame[frame["problem"] == problem]
        columns = [
            "method",
            "kind",
            "setting",
            "steps",
            "error",
            "energy error",
            "angular momentum error",
            "seconds",
            "status",
        ]
        body.append(table(everything, columns))
        body.append(f"Uncertainty of the reference: {number(members['reference uncertainty'].max())}.\n")
        for r in everything[everything["status"] != "ok"].itertuples():
            body.append(f"- {r.method}, {r.setting}: {r.status}: {r.reason}")
    return verdict, "\n".join(body)


PAGE = Page(
    "kepler",
    "Kepler, beside the established integrators",
    "what an accuracy costs here and in heyoka, REBOUND and SciPy",
    ("peers",),
    _write,
)
