r"""Linear stability: all stable h omega of every method, confirmed by long runs and compared with known limits.

Scheme I (symplectic Euler for lambda = 0 or 1, the midpoint rule for 1/2) has a limit in closed form for every lambda:
with z = h omega the trace of the step matrix is 2 - z^2 / (1 + lambda (1 - lambda) z^2), so that the step is stable
where z |1 - 2 lambda| < 2.  The limit is measured for lambda from -10 to 11.

A known limit is ``derived`` in closed form from the trace and the determinant of the step's matrix (the tests derive
each one again, exactly, from the coefficients that the authors give, not from this project's records), or ``printed``
by a publication or software that states it, and was looked up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure import oscillator
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY, Count, at_most
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.registry import BY_ID, METHODS

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.integrator import Integrator
    from phasebench.benchmarks.measure.own_step import System
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
#: A gap is run only where |tr M| exceeds 2 by this: less does not grow by `GROWTH` in `STEPS` steps.
DEEP = 1e-6
#: The h omega at which a method that is stable at every step is run.
BEYOND = (7.0, 70.0)
OSCILLATOR = ProblemKey(oscillator.PROBLEM)

# -- known limits ------------------------------------------------------------------------------------------------------

UNLIMITED = math.inf
#: Significant digits in which a limit must agree.
DIGITS = 10
#: Sources that state a limit.
KOBAYASHI = "Kobayashi 2007, Phys. Lett. A 371, 360 (arXiv:0705.4523): q and p grow for steps from 2 on"
NODEPY = "Ketcheson et al. 2020, JOSS 5, 2515: NodePy prints 2.8284271247"
GAUSS = "documentation of the Rust package differential-equations 0.3: Gauss-Legendre methods are A-stable"
RADAU = "documentation of OrdinaryDiffEq.jl: RadauIIA3 and RadauIIA5 are A-, B- and L-stable"
IMEX = "McLachlan & Stern 2014 (arXiv:1305.3216): the midpoint rule for the fast, linear part, free of resonances"


class Limit(NamedTuple):
    """A known limit of h omega, the formula from which it follows, the source that states it, and lambda ("" if none).

    ``method`` is a method's id, or a name in `OTHERS`.
    """

    method: str
    value: float
    derived: str
    printed: str = ""
    lam: str = ""

    @property
    def parameters(self) -> dict[str, str]:
        """The method's parameters."""
        return {"lam": self.lam} if self.lam else {}


def _runge_kutta(rows: Sequence[Sequence[float]], weights: Sequence[float]) -> Callable:
    """The step of an explicit Runge-Kutta method, from the rows of its matrix up to the diagonal and its weights."""

    def step(system: System, q: np.ndarray, p: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        slopes = []
        for row in (*rows, weights):
            at_q = q + h * sum((a * k for a, (k, _) in zip(row, slopes, strict=False)), 0 * q)
            at_p = p + h * sum((a * k for a, (_, k) in zip(row, slopes, strict=False)), 0 * p)
            slopes.append((system.dH_dp(at_q, at_p), -system.dH_dq(at_q, at_p)))
        return at_q, at_p

    return step


#: Methods that the registry lacks: Heun's of order 2 and Kutta's of order 3.
OTHERS = {
    "heun-2": _runge_kutta(((), (1.0,)), (0.5, 0.5)),
    "kutta-3": _runge_kutta(((), (0.5,), (-1.0, 2.0)), (1 / 6, 2 / 3, 1 / 6)),
}
_CUBE = 2 ** (1 / 3)
_OMELYAN = (2 * math.sqrt(326) + 36) ** (1 / 3)
#: The fraction of McLachlan's symmetric two-stage method, 0.1931833275.
MCLACHLAN = 1 / 2 - _OMELYAN / 12 + 1 / (6 * _OMELYAN)
_VERLET = "tr = 2 - z^2"
_SCHEME_I = "tr = 2 - z^2 / (1 + lam (1 - lam) z^2), so z |1 - 2 lam| = 2"
_SCHEME_III = "two substeps of Scheme I and its adjoint"
_MIDPOINT = "tr = 2 (4 - z^2) / (4 + z^2), det = 1"
_PADE = "R(i z) is a Pade approximation"
LIMITS = (
    Limit("symplectic-euler-p", 2.0, _VERLET, KOBAYASHI),
    Limit("symplectic-euler-q", 2.0, _VERLET, KOBAYASHI),
    Limit("stormer-verlet", 2.0, _VERLET, KOBAYASHI),
    Limit("stormer-verlet-dkd", 2.0, _VERLET, KOBAYASHI),
    Limit("lobatto-iiia-iiib-2", 2.0, f"{_VERLET}: Stormer-Verlet"),
    Limit("lobatto-iiia-iiib-3", math.sqrt(8), "tr = 2 (48 - 22 z^2 + z^4) / (48 + 2 z^2)"),
    Limit("variational-trapezoidal", 2.0, f"{_VERLET}: Stormer-Verlet"),
    Limit("explicit-euler", 0.0, "det = 1 + z^2"),
    Limit("heun-2", 0.0, "det = 1 + z^4 / 4"),
    Limit("kutta-3", math.sqrt(3), "det = 1 - z^4 / 12 + z^6 / 36"),
    Limit("rk4", math.sqrt(8), "det = 1 - z^6 / 72 + z^8 / 576", NODEPY),
    Limit("mclachlan-s2", math.sqrt(2 / (1 / 2 - MCLACHLAN)), "two stages of fraction b: z^2 = 2 / (1/2 - b)"),
    Limit("saba-2", 2 * 3**0.25, "two stages of fraction b = 1/2 - 3^(1/2) / 6: z^2 = 2 / (1/2 - b)"),
    Limit("mclachlan-atela-2", 2.2644837646238005, "the first root of tr = -2, of degree 4"),
    Limit("ruth-3", 2.5074811709523557, "the first root of |tr| = 2, of degree 6"),
    Limit("forest-ruth", (2 - _CUBE) * math.sqrt(2 * (1 + _CUBE)), "z = (2 - 2^(1/3)) (2 + 2^(4/3))^(1/2)"),
    Limit("implicit-euler", UNLIMITED, "det = 1 / (1 + z^2)"),
    Limit("implicit-midpoint", UNLIMITED, _MIDPOINT),
    Limit("gauss-2", UNLIMITED, f"{_PADE} of modulus 1", GAUSS),
    Limit("gauss-4", UNLIMITED, f"{_PADE} of modulus 1", GAUSS),
    Limit("radau-iia-3", UNLIMITED, f"{_PADE} of modulus below 1", RADAU),
    Limit("imex", UNLIMITED, f"{_MIDPOINT}: the midpoint rule", IMEX),
    Limit("avf", UNLIMITED, f"{_MIDPOINT}: the midpoint rule"),
    Limit("deuflhard", UNLIMITED, "tr = 2 cos z: exact"),
    Limit("scheme-i", 2 / 3, _SCHEME_I, lam="-1"),
    Limit("scheme-i", 6.0, _SCHEME_I, lam="1/3"),
    Limit("scheme-i", UNLIMITED, _SCHEME_I, lam="1/2"),
    Limit("scheme-iii", 1.0, _SCHEME_III, lam="-1"),
    Limit("scheme-iii", 3.0, _SCHEME_III, lam="1/3"),
)


def limit(id: str | Callable, **parameters: str) -> tuple[float, oscillator.Found]:
    """(The stability limit of h omega, infinite if there is none; all that was found)."""
    found = oscillator.find(integrator(id, parameters=parameters))
    return math.inf if found.limit is None else found.limit, found


def known_limits(known: bool) -> list[dict]:
    """Every known limit beside the measured one."""
    rows = []
    for each in LIMITS:
        value, _ = limit(OTHERS.get(each.method, each.method), **each.parameters)
        row = {"method": each.method, "parameters": " ".join(f"{k}={v}" for k, v in each.parameters.items())}
        row |= {"measured": value, "known limit": each.value, "digits": DIGITS, "agrees": agrees(value, each.value)}
        evidence = " and ".join(name for name in ("derived", "printed") if getattr(each, name))
        rows.append(row | {"evidence": evidence, "derived": each.derived, "printed": each.printed})
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


def parameters(method: Method) -> list[dict[str, str]]:
    """The parameters at which a method is measured: its own; those of `SWEPT` if lambda is the only one."""
    free = set(method.parameters) == {"lam"} and method.order <= HIGHEST
    own = {k: str(v) for k, v in method.parameters.items()}
    return [own, *({"lam": value} for value in SWEPT if free and {"lam": value} != own)]


def _able(method: Method) -> bool:
    """True if the oscillator has all the structure that a method requires."""
    return not {"Poisson structure", "further invariants"} & {r.partition("(")[0] for r in method.requires}


#: Label -> (method, its parameters)
RUNS = {BY_ID[m.id](**p).label if p else m.id: (m, p) for m in METHODS if _able(m) for p in parameters(m)}


def linear(label: str) -> dict:
    """The stable intervals of h omega, confirmed by long runs; no results if the oscillator lacks what is required."""
    method, values = RUNS[label]
    chosen = integrator(method.id, parameters=values)
    if chosen.lacks(problem(oscillator.PROBLEM)):
        return {"label": label, "method": method.id, "how": "not on the oscillator"}
    value, found = limit(method.id, **values)
    widths = [b - a for a, b in gaps(found)]
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


def gaps(found: oscillator.Found) -> list[tuple[float, float]]:
    """The unstable intervals of h omega between stable ones."""
    return [(a[1], b[0]) for a, b in zip(found.intervals, found.intervals[1:], strict=False)]


def grows(chosen: Integrator, z: float) -> bool:
    """True if a long run at h omega = z grows beyond bounds, or cannot be made.

    The bound is relative to the size of the step matrix, since a bounded run may be as large as that.  A run of a
    damping method is shortened so that it ends before its numbers are denormal.
    """
    M = oscillator.matrix(chosen, z)
    if M is None:
        return True
    rate = -math.log(max(_radius(chosen, z), 1e-9)) if chosen.record.one_step else 0.0
    y = oscillator.end(chosen, z, STEPS if rate <= 0 else max(1, min(STEPS, int(DAMPED / rate))))
    return y is None or not np.isfinite(y).all() or bool(np.abs(y).max() > GROWTH * (1 + np.abs(M).max()))


def confirm(chosen: Integrator, found: oscillator.Found) -> tuple[int, int]:
    """(Long runs that end as the step matrix predicts, all of them): at the limit, in later intervals, in gaps."""
    if found.how == oscillator.RUNS:
        return 0, 0
    end = found.limit
    if found.how == oscillator.ROOTS:
        asked = [(end * (1 - BESIDE), False), (end * (1 + BESIDE), True)]
    elif end is None:
        asked = [(z, False) for z in BEYOND if z < found.scanned and not _near(z, found.touches)]
    elif end == 0:
        asked = [(z, True)] if (z := _growing(chosen)) else []
    else:
        asked = [(end * (1 - BESIDE), False), *((z, True) for z in beyond(chosen, found))]
        middles = [(a + b) / 2 for a, b in found.intervals[1:] if b is not None]
        asked += [(z, False) for z in middles if not _near(z, found.touches)]
        asked += [((a + b) / 2, True) for a, b in gaps(found) if _depth(chosen, (a + b) / 2) > DEEP]
    return sum(grows(chosen, z) is expected for z, expected in asked), len(asked)


def beyond(chosen: Integrator, found: oscillator.Found) -> list[float]:
    """At most one h omega past the stability limit at which a long run must grow.

    It is the first of three candidates, at growing distances, at which the step matrix M makes a run grow fast enough
    to be seen, else the first; candidates not below the next stable interval do not count.  Where |tr M| - 2 grows as
    a higher power of the distance from the limit, the nearest candidate would grow too slowly.
    """
    following = found.intervals[1][0] if len(found.intervals) > 1 else math.inf
    tried = [z for k in (1, 10, 100) if (z := found.limit * (1 + k * BESIDE)) * (1 + BESIDE) < following]
    return [z for z in tried if _depth(chosen, z) > DEEP][:1] or tried[:1]


def _near(z: float, touches: Iterable[float]) -> bool:
    """True if h omega = z is so near to one of ``touches``, where |tr M| only touches 2, that round-off decides."""
    return any(abs(z - t) < 1e-6 for t in touches)


def _depth(chosen: Integrator, z: float) -> float:
    """(Spectral radius - 1)^2 of a step matrix at h omega = z, about |tr M| - 2; 0 if no step can be taken."""
    radius = _radius(chosen, z)
    return (radius - 1) ** 2 if math.isfinite(radius) else 0.0


def _radius(chosen: Integrator, z: float) -> float:
    """The spectral radius of a step's matrix at h omega = z; infinite if no step can be taken."""
    M = oscillator.matrix(chosen, z)
    return math.inf if M is None else float(np.abs(np.linalg.eigvals(M)).max())


def _growing(chosen: Integrator) -> float:
    """The least of a few h omega at which a long run of a method without a stable step must grow; 0 if none."""
    return next((z for z in (0.1, 0.3, 0.5, 0.9) if _depth(chosen, z) ** 0.5 * STEPS > 2 * math.log(GROWTH)), 0.0)


# -- judging, and what is shown ----------------------------------------------------------------------------------------


def met(rows: pd.DataFrame) -> pd.Series:
    """True for a known limit that is met, by method."""
    return rows.set_index("method")["agrees"].astype(bool)


def off(rows: pd.DataFrame) -> pd.Series:
    """The relative difference from the closed form."""
    return (rows["limit"] / rows["closed form"] - 1).abs()


def unconfirmed(rows: pd.DataFrame) -> str:
    """The first methods with long runs that do not end as predicted."""
    labels = list(rows.loc[rows["confirmed"] < rows["runs"], "label"])
    return join_list(labels, 3) if labels else ""


def long_runs(rows: pd.DataFrame) -> Count:
    """The long runs that end as predicted."""
    return Count(int(rows["confirmed"].sum()), int(rows["runs"].sum()))


@of(KNOWN)
def table(known: pd.DataFrame) -> Table:
    """Measured beside known limits, disagreeing ones first, then finite ones."""
    order = known.assign(endless=np.isinf(known["known limit"])).sort_values(["agrees", "endless"], kind="stable")
    shown = order.head(ROWS).astype(dict.fromkeys(("parameters", "derived", "printed"), object)).fillna("")

    def text(value: float) -> str:
        return "none" if np.isinf(value) else f"{value:.11g}"

    columns = {
        "method": shown["method"] + shown["parameters"].map(lambda p: f" ({p})" if p else ""),
        "measured": shown["measured"].map(text),
        "known": shown["known limit"].map(text),
        "it is": shown["evidence"],
        "by": shown["derived"],
        "printed by": shown["printed"],
    }
    caption = (
        "Measured limits of h ω beside those that are known, derived as `by` says, or printed; none: stable at every "
        "step."
    )
    return Table(pd.DataFrame(columns), caption)


@of(KNOWN)
def whole(known: pd.DataFrame) -> pd.DataFrame:
    """Every known limit with the measured one."""
    return known.drop(columns=["known"])


#: The claims of this page; that of `extremes` makes them, too.
CLAIMS = {
    "known": Claim(
        "Known stability limits of hω are met to the digits that are given",
        KNOWN, met, EVERY, unit="limits", names=3, fault=True,
    ),
    "closed": Claim(
        "Scheme I's stability limit is hω = 2 / |1 − 2λ|",
        SCHEME_I, off, at_most(SHARP), rows="`closed form` < inf", unit="relative difference", where="λ = {lam}",
        fault=True,
    ),
    "runs": Claim(
        "Long runs beside the limits stay bounded or grow as the step map predicts",
        LINEAR, long_runs, EVERY, rows="runs > 0", unit="runs", where=unconfirmed, fault=True,
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
             needs=(*(BY_ID[k.method] for k in LIMITS if k.method in BY_ID), OSCILLATOR)),
        Runs(SCHEME_I, scheme_i, [{"method": "scheme-i"}], needs=lambda method: (BY_ID[method], OSCILLATOR)),
        Runs(LINEAR, linear, [{"label": label} for label in RUNS],
             needs=lambda label: (RUNS[label][0], RUNS[label][1], OSCILLATOR)),
    ),
    claims=CLAIMS,
    shown=table,
    whole=whole,
    limits=(
        "The derivations share no code and no coefficients with the methods, but their author.",
        "Printed limits were read in abstracts and in the documentation of software; books were not at hand.",
        "A limit on the oscillator is no limit on another problem: see [how far a method can be "
        "pushed](extremes.md).",
    ),
    within="extremes",
    listed=False,
)  # fmt: skip
