r"""Linear stability: all stable h omega of every method, confirmed by long runs and compared with known limits.

Scheme I (symplectic Euler for lambda = 0 or 1, the midpoint rule for 1/2) has a limit in closed form for every lambda:
with z = h omega the trace of the step matrix is 2 - z^2 / (1 + lambda (1 - lambda) z^2), so that the step is stable
where z |1 - 2 lambda| < 2.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.linear_stability import radius
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture, total
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import at_most
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.registry import BY_ID, METHODS

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.integrator import Integrator
    from phasebench.integrators.record import Method

LINEAR, SCHEME_I, KNOWN = "extremes_linear", "extremes_scheme_i", "extremes_published"
#: Methods of at most this order whose only parameter is lambda are measured at each of these lambdas, too.
HIGHEST = 2
SWEPT = ("-10", "-2", "-1", "0", "1/3", "1/2", "2/3", "1", "2", "11")
#: The lambdas of Scheme I; largest relative difference from the closed form.
LAMBDAS, SHARP = tuple(str(Fraction(k, 2)) for k in range(-20, 23)), 1e-10
#: Long runs near an end of stability: relative distance from it, steps, the growth that counts as unstable.
BESIDE, STEPS, GROWTH = 1e-4, 100_000, 1e6
#: A damped run is followed until its amplitude has fallen by exp(-DAMPED).
DAMPED = 300.0
#: A gap is run only where the spectral radius exceeds 1 by this: less does not grow by `GROWTH` in `STEPS` steps.
DEEP = 1e-3
#: The h omega at which a method that is stable at every step is run.
BEYOND = (7.0, 70.0)
#: Number of methods in the figure of stable intervals, and the end of its axis.
BARS, LAST = 26, 10.0
OSCILLATOR = ProblemKey(oscillator.PROBLEM)
#: The known limits, significant digits in which a limit must agree, and two methods that the registry lacks.
FILE = tomllib.loads(Path(__file__).with_name("limits.toml").read_text(encoding="utf-8"))
LIMITS, DIGITS = FILE["limits"], 10
OTHERS = {
    "heun-2": replace(BY_ID["rk4"], id="heun-2", order=2, data=((0, 0), (1, 0), (0.5, 0.5))),
    "kutta-3": replace(
        BY_ID["rk4"], id="kutta-3", order=3,
        data=((0, 0, 0), (0.5, 0, 0), (-1, 2, 0), (Fraction(1, 6), Fraction(2, 3), Fraction(1, 6))),
    ),
}  # fmt: skip


def limit(method: str | Method, **parameters: str) -> tuple[float, oscillator.Found]:
    """(The stability limit of h omega, infinite if there is none; all that was found)."""
    found = oscillator.find(integrator(method, parameters=parameters))
    return math.inf if found.limit is None else found.limit, found


def known_limits(known: bool) -> list[dict]:
    """Every known limit beside the measured one."""
    rows = []
    for each in LIMITS:
        id, told, values = each["method"], each["value"], {"lam": each["lam"]} if "lam" in each else {}
        value, _ = limit(OTHERS.get(id, id), **values)
        row = {"method": id, "parameters": " ".join(f"{k}={v}" for k, v in values.items())}
        row |= {"measured": value, "known limit": told, "digits": DIGITS, "agrees": agrees(value, told)}
        row |= {"evidence": " and ".join(name for name in ("derived", "printed") if name in each)}
        rows.append(row | {"derived": each["derived"], "printed": FILE["sources"].get(each.get("printed"), "")})
    return rows


def agrees(value: float, expected: float, digits: int = DIGITS) -> bool:
    """True if a measured limit equals a known one to ``digits`` significant digits."""
    if math.isinf(expected) or expected == 0:
        return value == expected
    return math.isfinite(value) and f"{value:.{digits - 1}e}" == f"{expected:.{digits - 1}e}"


def scheme_i(method: str) -> list[dict]:
    """Scheme I's limit beside its closed form: a row for each of `LAMBDAS`."""
    rows = []
    for lam in map(Fraction, LAMBDAS):
        (value, found), slope = limit(method, lam=str(lam)), abs(1 - 2 * lam)
        row = {"lam": float(lam), "limit": value, "closed form": float(2 / slope) if slope else math.inf}
        rows.append(row | {"intervals": len(found.intervals)})
    return rows


# -- every method ------------------------------------------------------------------------------------------------------


def _parameters(method: Method) -> list[dict[str, str]]:
    """Its own, and those of `SWEPT` if lambda is the only one; none if the oscillator lacks a structure."""
    if {"Poisson structure", "further invariants"} & {r.partition("(")[0] for r in method.requires}:
        return []
    free = set(method.parameters) == {"lam"} and method.order <= HIGHEST
    own = {k: str(v) for k, v in method.parameters.items()}
    return [own, *({"lam": value} for value in SWEPT if free and {"lam": value} != own)]


#: Label -> (method, its parameters)
RUNS = {BY_ID[m.id](**p).label if p else m.id: (m, p) for m in METHODS for p in _parameters(m)}


def linear(label: str) -> dict:
    """The stable intervals of h omega, confirmed by long runs; no results if the oscillator lacks what is required."""
    method, values = RUNS[label]
    chosen = integrator(method.id, parameters=values)
    if chosen.lacks(problem(oscillator.PROBLEM)):
        return {"label": label, "method": method.id, "how": "not on the oscillator"}
    value, found = limit(method.id, **values)
    widths = [b - a for a, b in _gaps(found)]
    right, runs = confirm(chosen, found)
    return {
        "label": label,
        "method": method.id,
        "family": method.family,
        "order": chosen.order,
        "symplectic": method.symplectic,
        "limit": value,
        "intervals": " ".join(f"{a:.11g}..{'' if b is None else f'{b:.11g}'}" for a, b in found.intervals),
        "gaps": len(widths),
        "narrowest gap": min(widths, default=math.nan),
        "touches": len(found.touches),
        "first touch": found.touches[0] if found.touches else math.nan,
        "how": found.how,
        "scanned": found.scanned,
        "confirmed": right,
        "runs": runs,
        "reason": found.reason,
    }


def _gaps(found: oscillator.Found) -> list[tuple[float, float]]:
    return [(a[1], b[0]) for a, b in pairwise(found.intervals)]


def grows(chosen: Integrator, z: float) -> bool:
    """True if a long run at h omega = z grows beyond bounds, or cannot be made.

    The bound is relative to the size of the step matrix, since a bounded run may be as large as that.  A run of a
    damping method is shortened so that it ends before its numbers are denormal.
    """
    M = oscillator.matrix(chosen, z)
    if M is None:
        return True
    rate = -math.log(max(radius(M), 1e-9)) if chosen.record.one_step else 0.0
    y = oscillator.end(chosen, z, STEPS if rate <= 0 else max(1, min(STEPS, int(DAMPED / rate))))
    return y is None or not np.isfinite(y).all() or bool(np.abs(y).max() > GROWTH * (1 + np.abs(M).max()))


def confirm(chosen: Integrator, found: oscillator.Found) -> tuple[int, int]:
    """(Long runs that end as the step matrix predicts, all of them): at the limit, in later intervals, in gaps."""
    end, stable, unstable = found.limit, [], []
    if found.how == oscillator.ROOTS:
        stable, unstable = [end * (1 - BESIDE)], [end * (1 + BESIDE)]
    elif found.how != oscillator.RUNS and end is None:
        stable = [z for z in BEYOND if z < found.scanned]
    elif found.how != oscillator.RUNS and end == 0:
        least = 2 * math.log(GROWTH) / STEPS
        unstable = [z for z in (0.1, 0.3, 0.5, 0.9) if _unstable(chosen, z, least)][:1]
    elif found.how != oscillator.RUNS:
        stable = [end * (1 - BESIDE), *((a + b) / 2 for a, b in found.intervals[1:] if b is not None)]
        unstable = beyond(chosen, found) + [(a + b) / 2 for a, b in _gaps(found) if _unstable(chosen, (a + b) / 2)]
    # Where |tr M| only touches 2, round-off decides.
    stable = [z for z in stable if not any(abs(z - touch) < 1e-6 for touch in found.touches)]
    right = [not grows(chosen, z) for z in stable] + [grows(chosen, z) for z in unstable]
    return sum(right), len(right)


def beyond(chosen: Integrator, found: oscillator.Found) -> list[float]:
    """At most one h omega past the stability limit at which a long run must grow.

    It is the first of three candidates, at growing distances, at which the step matrix M makes a run grow fast enough
    to be seen, else the first; candidates not below the next stable interval do not count.  Where |tr M| - 2 grows as
    a higher power of the distance from the limit, the nearest candidate would grow too slowly.
    """
    following = found.intervals[1][0] if len(found.intervals) > 1 else math.inf
    tried = [z for k in (1, 10, 100) if (z := found.limit * (1 + k * BESIDE)) * (1 + BESIDE) < following]
    return [z for z in tried if _unstable(chosen, z)][:1] or tried[:1]


def _unstable(chosen: Integrator, z: float, least: float = DEEP) -> bool:
    """True if the spectral radius of the step at h omega = z exceeds 1 by more than ``least``."""
    M = oscillator.matrix(chosen, z)
    return M is not None and radius(M) - 1 > least


# -- what is shown -----------------------------------------------------------------------------------------------------


def pieces(text: str | float) -> list[tuple[float, float]]:
    """Intervals stored as text, "a..b c..", as pairs (a, b); an open end is infinite."""
    parts = [] if not isinstance(text, str) else [part.partition("..")[::2] for part in text.split()]
    return [(float(a), float(b) if b else math.inf) for a, b in parts]


@picture(
    LINEAR, "extremes-intervals", "stable steps",
    "Stable steps on the harmonic oscillator of the methods with the most gaps between stable intervals; blue: "
    "symplectic, orange: not. The first gap of some is narrower than a line.",
)  # fmt: skip
def draw(rows: pd.DataFrame) -> style.Figure:
    """The stable intervals of h omega, for the methods with the most gaps between them."""
    known = rows[rows["intervals"].notna() & np.isfinite(rows["limit"]) & ~rows["label"].str.contains("lam=")]
    shown = known.sort_values(["gaps", "limit"], ascending=False).head(BARS).sort_values("limit")
    figure, ((axes,),) = style.panels(1, 1, 4.4)
    for k, row in enumerate(shown.itertuples()):
        spans = [(a, min(b, LAST) - a) for a, b in pieces(row.intervals) if a < LAST]
        axes.broken_barh(spans, (k - 0.35, 0.7), color=style.BLUE if row.symplectic else style.ORANGE)
    axes.set_yticks(range(len(shown)), shown["label"])
    axes.set(xlabel="h ω", xlim=(0, LAST))
    return figure


@of(KNOWN)
def _table(known: pd.DataFrame) -> Table:
    order = known.assign(endless=np.isinf(known["known limit"])).sort_values(["agrees", "endless"], kind="stable")
    shown = order.head(ROWS).astype(dict.fromkeys(("parameters", "derived", "printed"), object)).fillna("")
    columns = {
        "method": shown["method"] + shown["parameters"].map(lambda p: f" ({p})" if p else ""),
        "measured": shown["measured"].map("{:.11g}".format).replace("inf", "none"),
        "known": shown["known limit"].map("{:.11g}".format).replace("inf", "none"),
        "it is": shown["evidence"],
        "by": shown["derived"],
        "printed by": shown["printed"],
    }
    caption = (
        "Measured limits of h ω beside those that are known, derived as `by` says, or printed; none: stable at every "
        "step."
    )
    return Table(pd.DataFrame(columns), caption)


def _unconfirmed(rows: pd.DataFrame) -> str:
    labels = list(rows.loc[rows["confirmed"] < rows["runs"], "label"])
    return join_list(labels, 3) if labels else ""


#: The claims of this page; that of `extremes` makes them, too.
CLAIMS = {
    "known": Claim(
        "Known stability limits of hω are met to the digits that are given",
        KNOWN, "agrees", where="{method}", unit="limits", names=3, fault=True,
    ),
    "closed": Claim(
        "Scheme I's stability limit is hω = 2 / |1 − 2λ|",
        SCHEME_I, "abs(limit / `closed form` - 1)", at_most(SHARP), rows="`closed form` < inf",
        unit="relative difference", where="λ = {lam}", fault=True,
    ),
    "runs": Claim(
        "Long runs beside the limits stay bounded or grow as the step map predicts",
        LINEAR, total("confirmed", "runs"), rows="runs > 0", unit="runs", where=_unconfirmed, fault=True,
    ),
}  # fmt: skip
STUDY = Study(
    id="extremes-limits",
    place=190,
    question="Are the stability limits those that are known?",
    answer="On the harmonic oscillator {known} known stability limits of hω are met, and {runs} long runs beside "
    "measured limits end as predicted.",
    setting=(
        "H = (p² + ω² q²) / 2: a step is a matrix M(z), z = h ω, stable while |tr M| ≤ 2 and det M ≤ 1 (Jury's "
        "conditions).",
        "Measured: the columns of M are the compiled method's images of the unit vectors; ends are refined to ten "
        "digits.",
        "Derived: the trace and the determinant follow from the coefficients that the authors give, exactly or in 60 "
        "digits.",
        "Printed: others state the limit, where the table says.",
        "Long runs: beside each end, within later stable intervals and in gaps between them.",
    ),
    runs=(
        Runs(KNOWN, known_limits, [{"known": True}],
             needs=(*(BY_ID[k["method"]] for k in LIMITS if k["method"] in BY_ID), OSCILLATOR, FILE)),
        Runs(SCHEME_I, scheme_i, [{"method": "scheme-i"}], needs=lambda method: (BY_ID[method], OSCILLATOR)),
        Runs(LINEAR, linear, [{"label": label} for label in RUNS],
             needs=lambda label: (RUNS[label][0], RUNS[label][1], OSCILLATOR)),
    ),
    claims=CLAIMS,
    shown=_table,
    whole=of(KNOWN)(lambda known: known.drop(columns="known")),
    limits=(
        "The derivations share no code and no coefficients with the methods, but their author.",
        "Printed limits were read in abstracts and in the documentation of software; books were not at hand.",
        "A limit on the oscillator is no limit on another problem: see [how far a method can be "
        "pushed](extremes.md).",
    ),
    within="extremes",
    listed=False,
)  # fmt: skip
