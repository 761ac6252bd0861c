"""The certified references: how exact they are, how far they reach, and whether a second solver agrees."""

from __future__ import annotations

from phasebench.benchmarks.page.markdown import listed, number, table
from phasebench.benchmarks.page.page import Page
from phasebench.reference.certificates.make import FASTEST, SAFETY

COLUMNS = {
    "problem": "problem",
    "t_end": "t_end",
    "uncertainty": "uncertainty of the digits",
    "long double": "long double",
    "horizon": "horizon",
    "growth": "growth exponent",
    "rate": "rate (1/t)",
    "energy": "energy change (relative)",
    "distance": "Gauss 16",
    "its uncertainty": "its own uncertainty",
    "moved by": "moved by",
}


def _worst(frame, column: str) -> str:
    worst = frame.loc[frame[column].idxmax()]
    return f"{number(worst[column], 2)} ({worst['problem']} at t = {number(worst['t_end'])})"


def _write(data, figures):
    frame = data("references")
    if frame is None:
        return None
    frame = frame.copy()
    frame["changed"] = frame["changed"].astype(object).fillna("")
    moved, apart = frame[frame["changed"] != ""], frame[frame["disagree"] > 0]
    unstable, short = frame[frame["rate"].notna()], frame[~frame["holds to the end"].astype(bool)]
    verdict = [
        f"{len(frame)} references with {frame['states'].sum()} stored states were computed anew: "
        + (
            "none moved by more than its uncertainty."
            if moved.empty
            else "these changed: " + listed([f"{r.problem} ({r.changed})" for r in moved.itertuples()], 12) + "."
        ),
        f"The largest uncertainty of a stored state is {_worst(frame, 'uncertainty')}; "
        f"the energy changes by at most {number(frame['energy'].abs().max(), 2)} of the sum of its terms.",
        (
            f"In all {frame['pairs'].sum()} comparisons with another solver the distance is within the uncertainties."
            if apart.empty
            else f"Solvers disagree on {listed(list(apart['problem']), 12)}."
        )
        + f" The second solver's own uncertainty is at most {_worst(frame, 'its uncertainty')}, "
        + f"in the median {number(frame['its uncertainty'].median(), 2)}.",
        "Neighbouring trajectories part exponentially, as of a chaotic flow or an unstable orbit, on "
        + listed(
            [
                f"{r.problem} (rate {number(r.rate, 2)}, horizon {number(r.horizon)} of {number(r.t_end)})"
                for r in unstable.itertuples()
            ],
            12,
        )
        + ".",
        "Long double, the reference of a run whose end is not stored, leaves its limit before the end on "
        + listed([f"{r.problem} (after t = {number(r.horizon)} of {number(r.t_end)})" for r in short.itertuples()], 12)
        + ": no error of a trajectory is to be reported later.",
    ]
    body = [
        "Errors are max norms over (q, p), the largest at any time up to t_end, in the problem's own units. The digits are "
        "heyoka's Taylor run in quadruple precision, their uncertainty its distance from a run at a tolerance 50 times as "
        "large. _Long double_ and _Gauss 16_ (order 16, 8 stages, in NumPy's long double) are distances from these digits; "
        f"the Gauss method's own uncertainty is {SAFETY:g} times the difference of two step sizes, and its round-off grown as "
        f"neighbouring trajectories part. Horizon: the last time, on a grid, at which long double is within {number(frame['limit'].max())} of "
        "the state's max norm. Growth exponent: of the distance of neighbours as a power of t, over the later part of the span; "
        f"a rate is given where it exceeds {FASTEST:g}.\n",
        table(frame, COLUMNS),
    ]
    others = frame[frame["other solvers"].fillna("") != ""]
    if len(others):
        body.append("## Other solvers\n")
        body.append(
            table(
                others,
                {"problem": "problem", "t_end": "t_end", "other solvers": "distance at t_end (its own uncertainty)"},
            )
        )
    return verdict, "\n".join(body)


PAGE = Page(
    "references",
    "Certified references",
    "how exact the stored end states are, how far trajectories can be trusted, and whether a second solver agrees",
    ("references",),
    _write,
)
