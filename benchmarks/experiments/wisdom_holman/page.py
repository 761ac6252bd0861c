"""Wisdom-Holman splittings beside REBOUND's."""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.page.markdown import number, table
from phasebench.benchmarks.page.page import Page

#: Energy errors below this have a part of round-off, in which the two differ.
ROUND_OFF = 1e-11


def _write(data, figures):
    frame = data("wisdom_holman")
    if frame is None:
        return None
    verdict = []
    truncated = frame[(frame["energy error"] > ROUND_OFF) & (frame["REBOUND's energy error"] > ROUND_OFF)]
    if len(truncated):
        apart = np.abs(truncated["energy error"] / truncated["REBOUND's energy error"] - 1).max()
        verdict.append(
            f"Where the energy error is above {ROUND_OFF:g} ({len(truncated)} of {len(frame)} rows), it differs from "
            f"REBOUND's of the same splitting and step by at most {number(float(apart) * 100, 2)} %; early positions "
            f"differ by at most {number(float(frame['distance of early positions'].max()))} of the orbit's size."
        )
    least = frame.groupby("problem")[["energy error", "REBOUND's energy error"]].min()
    verdict.append(
        "The least energy errors, ours and REBOUND's: "
        + "; ".join(f"{case} {number(float(a))} and {number(float(b))}" for case, (a, b) in least.iterrows())
        + "."
    )
    for case, members in frame.groupby("problem", sort=False):
        low, middle, high = (members["time ratio"].quantile(x) for x in (0.25, 0.5, 0.75))
        plain = members[members["method"] == "wisdom-holman"]["ns per step"].median()
        verdict.append(
            f"{case}: a step takes {middle:.2f} times as long as REBOUND's (median of the rows, quartiles {low:.2f} to "
            f"{high:.2f}); wisdom-holman {number(float(plain))} ns."
        )
        best = members.loc[members["energy error"].idxmin()]
        small = members[members["energy error"] < 1e-9]
        if len(small):
            cheap = small.loc[(small["ns per step"] / small["h"]).idxmin()]
            verdict.append(
                f"{case}: the cheapest with an energy error below 1e-9 is {cheap['method']} at h = {number(cheap['h'])} "
                f"({number(float(cheap['ns per step'] / cheap['h']))} ns a unit of time)."
            )
        else:
            verdict.append(
                f"{case}: none has an energy error below 1e-9; the least is {number(float(best['energy error']))} by "
                f"{best['method']} at h = {number(best['h'])}."
            )
    body = [
        "Energy errors are relative, the greatest over 200 rows; distances are relative to the largest coordinate, the "
        "early ones over a tenth of the run. Times: warm, without output, medians of rounds in turns. Both sides use "
        "Jacobi coordinates with mu_k = G times the mass of the bodies up to k, join drifts over neighbouring steps "
        "(REBOUND with safe_mode = 0) and apply the corrector for rows alone; the sums here are compensated. The "
        "kernel of the corrected WHFast is the default one: REBOUND's lazy kernel is another method.\n"
    ]
    for case, members in frame.groupby("problem", sort=False):
        body += [f"## {case}\n", table(members.drop(columns="problem"))]
    return verdict, "\n".join(body)


PAGE = Page(
    "wisdom-holman",
    "Wisdom-Holman splittings beside REBOUND",
    "whether the splittings with a Kepler solver are REBOUND's, and what a step costs",
    ("wisdom_holman",),
    _write,
)
