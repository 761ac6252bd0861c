"""Semi-discretized wave equations: energy, mass and charge, and what a step costs."""

from __future__ import annotations

from phasebench.benchmarks.page.markdown import listed, number, table
from phasebench.benchmarks.page.page import Page

COLUMNS = {
    "method": "method",
    "h": "h",
    "energy error": "energy error",
    "energy error, steps without a root": "on steps without a root",
    "invariant error": None,
    "evaluations per step": "evaluations per step",
    "newton": "Newton solves",
    "fallbacks": "fallbacks",
    "seconds": "seconds",
    "status": "status",
}


def _kept(members, what, name):
    """A sentence: which methods keep something at every step that was measured, and the least error of the others."""
    kept = members.groupby("method", sort=False)[f"{what} is kept"].all()
    keep, lose = list(kept[kept].index), list(kept[~kept].index)
    text = f"the {name} is kept to round-off by {listed(keep, 12)}"
    if keep:
        text += f" (at most {number(members[members['method'].isin(keep)][f'{what} error'].max())})"
    if lose:
        text += f", not by {listed(lose, 12)} (error at least {number(members[members['method'].isin(lose)][f'{what} error'].min())})"
    return text


def _write(data, figures):
    frame = data("pde")
    if frame is None:
        return None
    ran = frame[frame["status"] == "ok"].copy()
    for column in ("energy is kept", "invariant is kept"):
        ran[column] = ran[column].astype(bool)
    verdict = []
    for problem, members in ran.groupby("problem", sort=False):
        name = members["invariant"].iloc[0]
        d, t_end = members["d"].iloc[0], members["t_end"].iloc[0]
        verdict.append(
            f"{problem}, d = {d}, to t = {number(t_end)}: {_kept(members, 'energy', 'energy of steps with a root')}; "
            f"{_kept(members, 'invariant', name)}."
        )
    missed = ran[ran["fallbacks"] > 0]
    verdict.append(
        "No step of any run is without a root."
        if missed.empty
        else f"Steps without a root, whose energy error a later step wins back: {listed([f'{r.method} on {r.problem} at h = {number(r.h)}: {int(r.fallbacks)}' for r in missed.itertuples()])}."
    )
    stopped = frame[~frame["status"].isin(["ok", "skipped"])]
    if len(stopped):
        verdict.append(f"{len(stopped)} runs did not reach the end: {listed(sorted(stopped['method'].unique()))}.")
    body = [
        "Both equations are discretized in space by central differences, which leaves a canonical system; that system is "
        "what is integrated. Multisymplectic box schemes, which discretize space and time together, are not part of this "
        "suite.\n",
        "The charge of the Klein-Gordon equation is an invariant of the form q.D p, which symplectic partitioned methods "
        "keep and Schemes I and III at every lambda, so IV and V too. The mass of the Schroedinger equation is of the form "
        "q.q + p.p: Scheme I keeps it at lambda = 1/2 alone. `seconds` is the warm integration without output; errors are "
        "absolute, over every step.\n",
    ]
    for problem, members in frame.groupby("problem", sort=False):
        columns = COLUMNS | {"invariant error": f"{members['invariant'].iloc[0]} error"}
        if members["energy error, steps without a root"].isna().all():
            columns.pop("energy error, steps without a root")
        body += [
            f"## {problem}\n",
            f"N = {members['N'].iloc[0]}, d = {members['d'].iloc[0]}.\n",
            table(members, columns),
            "",
        ]
        for r in members[members["status"] != "ok"].drop_duplicates("method").itertuples():
            body.append(f"- {r.method}: {r.status}: {r.reason}.")
        body.append("")
    return verdict, "\n".join(body)


PAGE = Page(
    "pde",
    "Wave equations, semi-discrete",
    "energy, mass and charge of Hamiltonian systems with many degrees of freedom",
    ("pde",),
    _write,
)
