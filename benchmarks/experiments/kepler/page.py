"""The Kepler comparison: four errors to 10^4 orbits, the perihelion's advance, error against cost."""

from __future__ import annotations

from math import pi

import pandas as pd

from phasebench.benchmarks.page.markdown import listed, number, table
from phasebench.benchmarks.page.page import Page

from . import figures as drawings
from .kepler import LONGEST, STANDARD

#: Phase errors, radians at the end, for which the cheapest is named; the same of the state's error.
PHASES = (1e-2, 1e-6, 1e-9)
WANTED = (1e-3, 1e-6, 1e-9)
#: A relative error of the energy or the angular momentum up to this counts as round-off.
ROUND_OFF = 1e-11
#: An exponent of growth within this of 1 is called linear.
NEAR = 0.15
#: Errors of the phase below this at the end, in radians, are of round-off: their growth says how it adds up.
PHASE_ROUND_OFF = 1e-7
#: A measured advance within this of the closed form, radians an orbit, is that number.
ADVANCE = 1e-13
#: A phase error larger than this many times what the energy error can do is a lost time.
CLOCK = 5.0
TITLES = {"kepler": "Kepler", "perturbed-kepler": "Kepler with the Schwarzschild term"}


def _ends(runs, growth):
    """The runs with the errors at their ends beside them."""
    key = ["problem", "e", "method", "setting"]
    last = growth.sort_values("orbits").groupby(key, sort=False, as_index=False).last()
    return runs.merge(last[[*key, "energy", "momentum", "phase", "perihelion"]], on=key, how="left")


def _who(row) -> str:
    """A method and its setting in a sentence."""
    steps = row["steps per orbit"]
    return (
        f"{row['method']} ({'adaptive' if pd.isna(steps) else f'{int(steps)} steps'}, {number(row['us per orbit'])} us)"
    )


def _tally(names) -> str:
    """Names by how often they occur."""
    return listed([f"{name} {n}" for name, n in pd.Series(names).value_counts().items()], 12)


def _cheapest(ends) -> tuple[list[str], list[str]]:
    """Who follows the phase for the least time, over the longest runs: (verdict, table)."""
    rows, winners = [], []
    for (problem, e), members in ends.groupby(["problem", "e"], sort=False):
        longest = members["orbits"].max()
        members = members[(members["orbits"] == longest) & members["us per orbit"].notna()]
        for wanted in PHASES:
            enough = members[members["phase"] <= wanted].sort_values("us per orbit")
            ours = enough[enough["kind"] == "phasebench"]
            row = {"problem": TITLES[problem], "e": e, "phase error up to (rad)": wanted}
            row["cheapest (time an orbit)"] = "none" if enough.empty else _who(enough.iloc[0])
            row["cheapest of this project"] = "none" if ours.empty else _who(ours.iloc[0])
            rows.append(row)
            if len(enough):
                winners.append(enough.iloc[0]["method"])
    if not winners:
        return [], []
    verdict = (
        f"The cheapest that follows the phase to {listed([f'{x:g}' for x in PHASES])} rad over "
        f"{ends['orbits'].max():.0f} orbits, of {len(rows)} pairs of an orbit and an accuracy: {_tally(winners)}."
    )
    return [verdict], ["## Who follows the phase for the least time\n", table(pd.DataFrame(rows))]


def _equal_time(ends) -> tuple[list[str], list[str]]:
    """Who has the least phase error in the same time: (verdict, table)."""
    rows, winners = [], []
    timed = ends[ends["setting"].str.startswith("time of")]
    for (problem, e), members in timed.groupby(["problem", "e"], sort=False):
        best = members.sort_values("phase")
        parts = [f"{r['method']} ({int(r['steps per orbit'])} steps) {number(r['phase'])}" for _, r in best.iterrows()]
        rows.append(
            {
                "problem": TITLES[problem],
                "e": e,
                "in the": best["setting"].iloc[0],
                "phase error (rad), the best five": ", ".join(parts[:5]),
            }
        )
        winners.append(best["method"].iloc[0])
    if not rows:
        return [], []
    verdict = (
        f"The least phase error after {timed['orbits'].max():.0f} orbits among fixed steps in the same time, of "
        f"{len(rows)} orbits: {_tally(winners)}."
    )
    return [verdict], ["## Phase errors in the same time\n", table(pd.DataFrame(rows))]


def _laws(ends) -> list[str]:
    """How the phase errors grow."""
    if "phase growth" not in ends:
        return []
    lines = []
    known = ends[ends["phase growth"].notna()]
    truncated, rounded = known[known["phase"] > PHASE_ROUND_OFF], known[known["phase"] <= PHASE_ROUND_OFF]
    if len(truncated):
        straight = (truncated["phase growth"] - 1).abs() <= NEAR
        others = [
            f"{r['method']} at e = {r['e']:g}, {r['setting']}: t^{r['phase growth']:.2f}"
            for _, r in truncated[~straight].iterrows()
        ]
        lines.append(
            f"Phase errors above {PHASE_ROUND_OFF:g} rad at the end grow linearly (exponent 1 within {NEAR:g}) in "
            f"{int(straight.sum())} of {len(truncated)} runs{f'; else {listed(others)}' if others else ''}."
        )
    if len(rounded):
        grown = rounded.groupby("method", sort=False)["phase growth"].median().sort_values()
        parts = [f"{m} {x:.2f}" for m, x in grown.items()]
        lines.append(
            f"Phase errors at most {PHASE_ROUND_OFF:g} rad at the end, {len(rounded)} runs, grow as t to the median "
            f"power {rounded['phase growth'].median():.2f} (3/2 for round-off that is random); by method "
            f"{listed(parts, 20)}."
        )
    return lines


def _clocks(ends) -> list[str]:
    """Phase errors of adaptive methods that are larger than their energy errors can make them."""
    parts = []
    for _, r in ends[(ends["mu"] == 0) & (ends["setting"] == "adaptive")].iterrows():
        # The frequency is (-2 H)^(3/2): an energy error within d turns the orbit by at most 3/2 d of its angle.
        most = 1.5 * r["energy"] * 2 * pi * r["orbits"]
        if r["phase"] > CLOCK * most:
            parts.append(
                f"{r['method']} at e = {r['e']:g} ({number(r['phase'])} rad, {number(most)} by its energy error)"
            )
    if not parts:
        return []
    return [
        f"Off by more than {CLOCK:g} times what the energy error can do to the phase: {listed(parts)}. The orbit is the right "
        "one, the place on it not: the time is lost, as where steps are added to a time in double precision."
    ]


def _kept(ends) -> list[str]:
    """Who keeps the energy, and the angular momentum, to round-off."""
    lines = []
    for column, name in (("energy", "energy"), ("momentum", "angular momentum")):
        groups = ends.groupby("method", sort=False)[column]
        worst = groups.max().sort_values()
        always = worst[worst <= ROUND_OFF]
        if len(always) == len(worst):
            who = f"every method; the greatest error is {number(worst.iloc[-1])}, of {worst.index[-1]}"
        else:
            who = listed([f"{m} ({number(x)})" for m, x in always.items()], 20)
        never = [f"{m} ({number(x)})" for m, x in groups.min().items() if x > ROUND_OFF]
        lines.append(
            f"The {name} is kept to {ROUND_OFF:g} in every run that gets through by {who}"
            f"{f'; in none by {listed(never, 20)}, with the least error in brackets' if never else ''}."
        )
    return lines


def _advances(ends) -> list[str]:
    """The measured advance of the perihelion beside the closed form."""
    if "advance error" not in ends:
        return []
    measured = ends[ends["advance error"].notna()]
    at = measured[measured["setting"].isin([f"{STANDARD} steps", "adaptive"])]
    if at.empty:
        return []
    closed = [
        f"{number(members['closed form'].iloc[0], 10)} at e = {e:g}" for e, members in measured.groupby("e", sort=False)
    ]
    worst = at["advance error"].abs().groupby(at["method"]).max().sort_values()
    same = listed(worst[worst <= ADVANCE].index, 20)
    parts = [f"{m} {number(x)}" for m, x in worst[worst > ADVANCE].items()]
    return [
        f"Advance of the perihelion, rad an orbit by the closed form: {listed(closed)}; to first order "
        f"{number(measured['first order'].iloc[0], 4)}. As measured at {STANDARD} steps or adaptively it is the closed "
        f"form's to {ADVANCE:g} at every e that gets through with {same}; the greatest differences are {listed(parts, 20)}."
    ]


def _sections(ends, growth, figures) -> list[str]:
    body = []
    for problem, members in ends.groupby("problem", sort=False):
        body.append(f"## {TITLES[problem]}\n")
        rows = growth[growth["problem"] == problem]
        standard = [s for s in dict.fromkeys(rows["setting"]) if s == f"{STANDARD} steps" or s.startswith("time of")]
        for setting in standard:
            for group in (g for g in dict.fromkeys(rows["group"].dropna()) if g):
                shown = rows[(rows["group"] == group) & rows["setting"].isin([setting, "adaptive"])]
                if shown.empty:
                    continue
                # Of all settings: a method looks the same in every figure of its group.
                names = {m: m for m in dict.fromkeys(rows[rows["group"] == group]["method"])}
                slug = f"kepler-{problem}-{group}-{setting}".replace(" ", "-")
                file = drawings.errors(shown, names, figures, f"{slug}.png")
                body.append(f"### Methods of {group}, {setting}\n")
                body.append(f"![errors of methods of {group} over orbits, {setting}](figures/{file})\n")
                stopped = members[
                    (members["group"] == group) & (members["setting"] == setting) & (members["status"] != "ok")
                ]
                parts = [f"{r.method} at e = {r.e:g} ({r.status})" for r in stopped.itertuples()]
                if parts:
                    body.append(f"Not through, drawn as far as they get: {listed(parts, 40)}.\n")
        columns = {
            "e": "e",
            "method": "method",
            "setting": "setting",
            "steps per orbit": "steps an orbit",
            "us per orbit": "us an orbit",
            "reached": "orbits",
            "energy": "energy",
            "energy, every step": "energy, every step",
            "momentum": "angular momentum",
            "phase": "phase (rad)",
            "phase growth": "exponent",
            "perihelion": "perihelion (rad)",
            "status": "status",
        }
        body += ["### All runs\n", table(members.sort_values("e", kind="stable"), columns)]
        if members["mu"].max() > 0 and "advance" in members:
            heads = {"e": "e", "method": "method", "setting": "setting", "advance": "advance an orbit (rad)"}
            heads |= {"advance error": "minus the closed form"}
            measured = members[members["advance"].notna()].sort_values("e", kind="stable")
            measured = measured.assign(advance=[f"{x:.12f}" for x in measured["advance"]])
            closed = members.groupby("e", as_index=False)[["mu", "period", "closed form", "first order"]].first()
            closed = closed.assign(**{"closed form": [f"{x:.15f}" for x in closed["closed form"]]})
            names = {"e": "e", "mu": "mu", "period": "radial period", "closed form": "closed form (rad an orbit)"}
            names |= {"first order": "first order 2 pi mu / L^4"}
            body += ["### The advance of the perihelion\n", table(closed, names), table(measured, heads)]
        for r in members[members["status"] != "ok"].itertuples():
            body.append(f"- e = {r.e:g}, {r.method}, {r.setting}: {r.status}: {r.reason}")
        body.append("")
    return body


def _cost(frame, figures) -> tuple[list[str], list[str]]:
    """The verdicts and the section of error against cost."""
    ok = frame[frame["status"] == "ok"]
    verdict = []
    body = [
        f"## Error against cost, {frame['orbits'].max():g} orbits at e = {frame['e'].max():g}\n",
        "Error in the maximum norm over (q, p) at the end, an apocentre, against a certified Taylor solution; seconds of "
        "the warm integration alone, without output (median). heyoka and REBOUND are compiled; SciPy's right-hand side "
        "is Python, which is most of its time.\n",
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
        verdict.append(f"{TITLES[problem]}, the cheapest state at the end with an error under {'; '.join(parts)}.")
        name = drawings.work_precision(members, problem, figures)
        body += [f"### {TITLES[problem]}\n", f"![work-precision diagram of {problem}](figures/{name})\n"]
        everything = frame[frame["problem"] == problem]
        columns = ["method", "kind", "setting", "steps", "error", "energy error", "angular momentum error", "seconds"]
        body.append(table(everything, [*columns, "status"]))
        body.append(f"Uncertainty of the reference: {number(members['reference uncertainty'].max())}.\n")
        for r in everything[everything["status"] != "ok"].itertuples():
            body.append(f"- {r.method}, {r.setting}: {r.status}: {r.reason}")
    return verdict, body


def _about(reference, ends) -> list[str]:
    """What is measured and how, for readers of the figures."""
    agree = number(float(reference["phase"].max()))
    yard = next((s.removeprefix("time of ") for s in ends["setting"] if s.startswith("time of ")), None)
    return [
        "An orbit is a radial period, 2 pi without the term; rows are half an orbit apart, at pericentres and "
        "apocentres of the exact orbit, and every error is the greatest so far over them (the column 'every step': over "
        "all steps of the first ten orbits). Energy and angular momentum are relative. Phase and perihelion are the "
        "angle variables of the problem itself: the mean longitude, and the direction of the pericentre, which moves "
        "uniformly along the exact motion; without the term they are the mean longitude and the direction of the "
        "Laplace-Runge-Lenz vector. On a circle the perihelion is undefined; with the term the orbit of e = 0 is none.\n",
        "The exact angles are linear in time, with period and advance from quadratures and elliptic integrals in "
        f"multiprecision; a Taylor series in long double departs from them by at most {agree} rad, which bounds what the "
        "measurement adds: smaller errors are not resolved. The advance is the growth of the perihelion per radial "
        "period over the whole run, at fixed radial phase.\n",
        "On the unperturbed problem a Wisdom-Holman splitting (WHFast, wisdom-holman) is the exact flow: it solves "
        "Kepler's equation and has nothing else to do, so that its errors are of round-off, and its few operations a step say "
        "nothing of a problem with a perturbation.\n",
        f"Equal time: each method takes as many steps an orbit as it can in the time of {yard}, by its own cost a step, "
        "as rounded to two digits; adaptive ones are shown at their default tolerance and their own time. Times are warm and "
        f"without output. Finer settings are left out where the whole run would take more than {LONGEST:g} s. A method of "
        "this project that takes much longer at any setting ends with the status timeout. The exponent is the slope of the "
        "logarithm of the "
        "phase error against that of time, from 10 orbits on: 1 where the frequency is wrong, 3/2 where round-off changes "
        "the energy at random (Brouwer 1937), 2 where it changes with a drift.\n",
    ]


def _write(data, figures):
    runs, growth, cost = data("kepler"), data("kepler_growth"), data("kepler_cost")
    verdict, body = [], []
    if runs is not None and growth is not None:
        ends = _ends(runs, growth)
        reference = ends[ends["kind"] == "reference"]
        ends, growth = ends[ends["kind"] != "reference"], growth[growth["kind"] != "reference"]
        ok = ends[(ends["status"] == "ok") & ends["phase"].notna()]
        tables = [_cheapest(ok), _equal_time(ok)]
        verdict += [*(v for said, _ in tables for v in said), *_laws(ok), *_clocks(ok), *_kept(ok), *_advances(ok)]
        failed = ends[~ends["status"].isin(["ok", "skipped"])]
        if len(failed):
            parts = [f"{m} {n}" for m, n in failed["method"].value_counts().items()]
            verdict.append(f"{len(failed)} of {len(ends)} runs do not get through: {listed(parts, 20)}.")
        body += [*_about(reference, ends), *(t for _, found in tables for t in found)]
        body += _sections(ends, growth, figures)
    if cost is not None:
        found, section = _cost(cost, figures)
        verdict += found
        body += section
    return (verdict, "\n".join(body)) if body else None


PAGE = Page(
    "kepler",
    "Kepler, beside the established integrators",
    "energy, angular momentum, phase and perihelion over 10^4 orbits, and what an accuracy costs, here and in heyoka, "
    "REBOUND and SciPy",
    ("kepler", "kepler_growth", "kepler_cost"),
    _write,
)
