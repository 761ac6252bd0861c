"""Schemes IV and V: energy on every step, and the steps without a root."""

from __future__ import annotations

from phasebench.benchmarks.page.markdown import number, table
from phasebench.benchmarks.page.page import Page
from phasebench.integrators.families.schemes_iv_v import RADIUS


def _write(data, figures):
    frame = data("energy_preservation")
    if frame is None:
        return None
    plain = frame[frame["scheme"].isin(["scheme-iv", "scheme-v"]) & (frame["status"] == "ok")]
    small = plain[plain["h"] <= 0.05]
    verdict = [
        f"Schemes IV and V to t = 1000 with h <= 0.05: energy error at most "
        f"{number(small['energy error, steps with a root'].max())} on the {int((small['steps'] - small['without a root']).sum())} "
        f"steps with a root; {int(small['without a root'].sum())} steps have none"
        + (
            f" (energy error there at most {number(small['energy error, steps without'].max())}, one step later "
            f"{number(small['one step later'].max())})."
            if small["without a root"].sum()
            else "."
        )
    ]
    if "angular momentum error" in plain:
        verdict.append(f"Angular momentum error at most {number(plain['angular momentum error'].max())} on every step.")
    if "scanned steps" in plain and plain["scanned steps"].sum():
        verdict.append(
            f"All {int(plain['scanned steps'].sum())} steps that the finder leaves without a root were scanned: "
            f"{int(plain['scan finds a root within the radius'].sum())} have one within |lambda - 1/2| < {RADIUS:g}."
        )
    for a, b in (("scheme-iv", "scheme-iv-v"), ("scheme-v", "scheme-v-iv")):
        both = [frame[(frame["scheme"] == s) & (frame["status"] == "ok")]["without a root"].sum() for s in (a, b)]
        verdict.append(f"{b} leaves {int(both[1])} steps without a root where {a} leaves {int(both[0])}.")
    body = [
        "A step without a root is taken with lambda = 1/2 and the target stays H0, so that a later step wins the energy "
        "back. `scheme-iv-v` takes such a step by Scheme V, `scheme-v-iv` by Scheme IV. The scan follows the stage "
        "equations in lambda from 1/2 to the fold or to 60 and shares no code with the root finder.\n",
        table(frame),
    ]
    return verdict, "\n".join(body)


PAGE = Page(
    "energy-preservation",
    "Energy-preserving steps",
    "how Schemes IV and V hold H0, and what happens on steps where no parameter does",
    ("energy_preservation",),
    _write,
)
