"""Times of a step, and the ratios that are claimed."""

from __future__ import annotations

from phasebench.benchmarks.page.markdown import table
from phasebench.benchmarks.page.page import Page


def _write(data, figures):
    ratios, speed = data("ratios"), data("speed")
    if ratios is None:
        return None
    limited = ratios[ratios["wanted, at most"].notna()]
    verdict = [
        f"{r['ratio']}: {r['median']:.2f} (quartiles {r['lower quartile']:.2f} to {r['upper quartile']:.2f}), wanted at most "
        f"{r['wanted, at most']:g}: {'met' if r['median'] <= r['wanted, at most'] else 'NOT met'}."
        for _, r in limited.iterrows()
    ]
    body = [
        "Each ratio is taken round by round in one run, the competitors in turns; medians and quartiles of the rounds.\n",
        table(ratios),
    ]
    if speed is not None:
        body.append("## Every method\n\nMedian time of a step, warm, without output.\n")
        for problem, members in speed.groupby("problem", sort=False):
            columns = ["method", "ns per step", "gradients per step", "energy error", "status"]
            body += [f"### {problem}\n", table(members, columns)]
    return verdict, "\n".join(body)


PAGE = Page(
    "speed", "Speed", "what a step costs, against a bare C loop and against each other", ("ratios", "speed"), _write
)
