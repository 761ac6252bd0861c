r"""Brouwer's law: the growth of round-off over long times, where the step map is known exactly.

On Kepler's orbit, by Wisdom-Holman's method, which solves it exactly, a change of the energy changes the period: the
error of the mean anomaly M = E - e sin E is the sum of the random walk.

Three arithmetics by hand: `PLAIN`, sums without compensation; `HALF`, exact products in twice the digits (Veltkamp
1968; Dekker 1971) and compensated sums, while velocity and force see the state rounded to a double; `WHOLE`, as `HALF`,
but velocity and force also see the part of the state that is rounded off.  A state is itself rounded, to epsilon, so
that the law shows only where epsilon h n^(1/2) is above epsilon.

Source: D. Brouwer, Astron. J. 46 (1937) 149-153; Hairer, Lubich, Wanner, Geometric Numerical Integration (2006),
VIII.5.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

import mpmath
import numba
import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import exact_maps
from phasebench.benchmarks.measure.exact_maps import DIGITS, exact_matrix
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS as SHOWN
from phasebench.benchmarks.page.page import Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import NONE, at_most
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators import batches
from phasebench.integrators.driver import integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID, METHODS

CHOSEN, CURVES, EVERY = "extremes_growth", "extremes_growth_curves", "extremes_growth_every"
OSCILLATOR, KEPLER, ON_KEPLER = "harmonic-oscillator", "wisdom-holman on Kepler", "wisdom-holman"
PLAIN, HALF, WHOLE = "plain sums", "products exact", "products exact, of the whole state"
BY_HAND = (PLAIN, HALF, WHOLE)
SPLITTER = 2.0**27 + 1
#: Starts, their seed, rows of a run and of a short one, points in the fit of an exponent (each at twice the time),
#: resamples.
STARTS, SEED, ROWS, FEWER, FITTED, DRAWN = 100, 1937, 1024, 64, 7, 400
#: Steps without a pattern: the usual one, and the long one of every method; lambda slightly off 1/3.
STEP, H, BESIDE = 0.0123456789, 0.0987654321, "0.3333333333"
#: Kinds of runs, as in the file.
USUAL, FRACTION, ASIDE_OF, HAND = "usual", "fraction", "beside a fraction", "by hand"
EPS = 2.0**-53
#: Kepler: range of the starts' eccentricities.
ECCENTRICITIES = (0.1, 0.6)
#: Steps of a run, by the cost of a step: explicit, implicit and composed methods in SIMD lanes, others, the slowest.
EXPLICIT, IMPLICIT, COMPOSED, ALONE, DEAR = 524_288, 131_072, 32_768, 16_384, 4_096
#: How the energy's error of every method is measured.
EXACT, ENERGY_KEPT = "exact matrix", "energy"
#: Brouwer's exponents, how far above them an interval may begin, and the largest energy error in units eps h n^(1/2).
ENERGY, PHASE, ABOVE, UNITS = 0.5, 1.5, 0.05, 10.0
#: Probability that an unbiased table of ensembles shows a bias by chance.
CHANCE = 0.05
MEAN = "bias in its errors"


def label(id: str, lam: str) -> str:
    """A method's id with its parameter, as "scheme-i(lam=1/3)"."""
    return f"{id}(lam={lam})" if lam else id


#: (Label, h, steps) -> the run, with its kind; the methods of shorter runs, lambda slightly off 1/3, where it drifts.
RUNS = {
    (label(run["method"], run.get("lam", "")), run["h"], run["steps"]): run | {"kind": kind}
    for kind, runs in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")).items()
    for run in runs
}
SUITABLE = {
    label(m.id, BESIDE if "lam" in m.parameters else ""): m for m in METHODS if m.symplectic or m.energy == "round-off"
}


# -- runs --------------------------------------------------------------------------------------------------------------


@numba.njit
def plain(h: float, every: int, rows: int, q: float, p: float) -> tuple[np.ndarray, np.ndarray]:
    """Leapfrog on the oscillator without compensated sums: Q, P (rows + 1,), after each ``every`` steps of h."""
    Q, P = np.empty(rows + 1), np.empty(rows + 1)
    Q[0], P[0] = q, p
    for i in range(rows):
        for _ in range(every):
            p = p - h / 2 * q
            q = q + h * p
            p = p - h / 2 * q
        Q[i + 1], P[i + 1] = q, p
    return Q, P


@numba.njit
def _halves(x: float) -> tuple[float, float]:
    t = SPLITTER * x
    high = t - (t - x)
    return high, x - high


@numba.njit
def _add(x: float, lost: float, step: float, h: float, y: float, unseen: float) -> tuple[float, float]:
    """x + step h (y + unseen), the product exact, the sum compensated: (the new x, what it loses); a step is exact."""
    (a, b), (c, d), product = _halves(h), _halves(y), h * y
    rest = ((a * c - product) + a * d + b * c) + b * d
    product, rest = step * product, step * (rest + h * unseen)
    new = (x + lost) + product
    moved = product + lost
    return new, (moved - (new - x)) + ((product - (moved - lost)) + rest)


@numba.njit
def careful(h: float, share: float, every: int, rows: int, q: float, p: float) -> tuple[np.ndarray, np.ndarray]:
    """As `plain`, with exact products and compensated sums.

    Velocity and force see ``share`` (0 or 1) of the state's lost parts, which the compensated sums carry along.
    """
    Q, P = np.empty(rows + 1), np.empty(rows + 1)
    Q[0], P[0] = q, p
    lost_q = lost_p = 0.0
    for i in range(rows):
        for k in range(2 * every + 1):
            if k % 2 == 1:
                q, lost_q = _add(q, lost_q, 1.0, h, p, share * lost_p)
            else:
                p, lost_p = _add(p, lost_p, -0.5 if k in (0, 2 * every) else -1.0, h, q, share * lost_q)
        Q[i + 1], P[i + 1] = q, p
    return Q, P


def by_hand(kind: str, h: float, steps: int, rows: int, q: float, p: float) -> tuple[np.ndarray, np.ndarray]:
    """A run of one of `BY_HAND` from (q, p): Q, P (rows + 1,)."""
    if kind == PLAIN:
        return plain(h, steps // rows, rows, q, p)
    return careful(h, float(kind == WHOLE), steps // rows, rows, q, p)


def starts(count: int) -> np.ndarray:
    """Random starts (q, p), array (count, 2): uniform in angle, amplitudes from 1/2 to 3/2."""
    generator = np.random.default_rng(SEED)
    angle, size = generator.uniform(0, 2 * np.pi, count), generator.uniform(0.5, 1.5, count)
    return np.column_stack([size * np.cos(angle), size * np.sin(angle)])


def run(
    id: str, values: dict, h: float, steps: int, starts: np.ndarray, rows: int = ROWS
) -> tuple[np.ndarray, np.ndarray]:
    """The oscillator's states (Q, P), arrays (n, rows + 1), from all starts (q, p), array (n, 2)."""
    if id in BY_HAND:
        Q, P = zip(*(by_hand(id, h, steps, rows, q, p) for q, p in starts), strict=True)
        return np.array(Q), np.array(P)
    options = {"h": h, "steps": steps, "parameters": values, "save_every": steps // rows, "threads": 1}
    made = integrate_ensemble(problem(OSCILLATOR), id, starts[:, :1], starts[:, 1:], **options)
    return made.Q[:, :, 0], made.P[:, :, 0]


def places(rows: int, count: int) -> list[int]:
    """Row 0, then ``count`` rows up to the last one, each at twice the time."""
    return [0, *(rows // 2**k for k in range(count - 1, -1, -1))]


def _needs(**key: object) -> tuple:
    told = RUNS[*key.values()]
    on_kepler, by_hand = told["method"] == KEPLER, told["method"] in BY_HAND
    id = ON_KEPLER if on_kepler else "stormer-verlet" if by_hand else told["method"]
    return BY_ID[id], told["kind"], told.get("lam", ""), ProblemKey("kepler" if on_kepler else OSCILLATOR)


def growth(label: str, h: float, steps: int) -> dict[str, list[dict]]:
    """A row on the growth of round-off in an ensemble, and rows of the rms errors over the number n of steps."""
    told = RUNS[label, h, steps]
    id, values, rows = told["method"], {"lam": told["lam"]} if "lam" in told else {}, places(ROWS, 10)
    n = np.array(rows) * (steps // ROWS)
    with mpmath.workdps(DIGITS):
        if id == KEPLER:
            made = [integrate(problem("kepler"), ON_KEPLER, h=h, steps=steps, q0=q, p0=p, save_every=steps // ROWS)
                    for q, p in pericentres(STARTS)]  # fmt: skip
            found = map(np.array, zip(*(kepler_errors(n, s.q[rows], s.p[rows], h) for s in made), strict=True))
        else:
            Q, P = run(id, values, h, steps, starts(told.get("starts", STARTS)))
            M = exact_matrix("stormer-verlet" if id in BY_HAND else id, values, h)
            found = exact_maps.errors(M, n, Q[:, rows], P[:, rows])
    n, energy, phase = n[1:], *(x[:, 1:] for x in found)
    row = {"kind": told["kind"]} | summary(n, h, energy, phase)
    if id == KEPLER:
        del row["in units"]  # a unit that holds on the oscillator only
    each = zip(n, np.sqrt((energy**2).mean(0)), np.sqrt((phase**2).mean(0)), strict=True)
    return {CHOSEN: [row], CURVES: [{"n": int(k), "energy": float(e), "phase": float(f)} for k, e, f in each]}


def summary(n: np.ndarray, h: float, energy: np.ndarray, phase: np.ndarray | None = None) -> dict:
    """Rms, bias and growth of errors by round-off, arrays (starts, m), at step numbers n (m,)."""
    rms = float(np.sqrt((energy[:, -1] ** 2).mean()))
    row = {"starts": len(energy), "energy rms": rms}
    if phase is not None:
        row["phase rms"] = float(np.sqrt((phase[:, -1] ** 2).mean()))
    row["in units"] = rms / float(EPS * h * np.sqrt(n[-1]))
    if len(energy) > 1:
        mean, error = energy[:, -1].mean(), energy[:, -1].std(ddof=1) / np.sqrt(len(energy))
        row |= {"bias per step": float(mean / n[-1]), MEAN: float(mean / error) if error else 0.0}
        for name, values in (("energy", energy), ("phase", phase)):
            if values is not None and values.any():
                row |= dict(zip((f"{name} exponent", f"{name} low", f"{name} high"), power(n, values), strict=True))
    return row


def power(n: np.ndarray, errors: np.ndarray) -> tuple[float, float, float]:
    """(Exponent of n in the rms of ``errors`` (starts, m) at the last `FITTED` n, low, high): 95 % by bootstrap."""
    x, generator = np.log(np.asarray(n[-FITTED:], float)), np.random.default_rng(SEED)

    def fit(sample: np.ndarray) -> float:
        size = np.maximum((sample[:, -FITTED:] ** 2).mean(axis=0), 1e-40)  # its logarithm is finite
        return float(np.polyfit(x, 0.5 * np.log(size), 1)[0])

    drawn = [fit(errors[generator.integers(0, len(errors), len(errors))]) for _ in range(DRAWN)]
    return fit(errors), *map(float, np.quantile(drawn, (0.025, 0.975)))


def elements(q: Sequence[float], p: Sequence[float]) -> tuple:
    """(Semi-major axis, mean anomaly) of a Kepler state q, p, (2,) each, in the working precision."""
    x, y, u, v = (mpmath.mpf(float(c)) for c in (*q, *p))
    r = mpmath.sqrt(x**2 + y**2)
    a = 1 / (2 / r - u**2 - v**2)
    cosine, sine = 1 - r / a, (x * u + y * v) / mpmath.sqrt(a)  # e cos E, e sin E
    return a, mpmath.atan2(sine, cosine) - sine


def kepler_errors(n: Sequence[int], Q: Sequence, P: Sequence, h: float) -> tuple[np.ndarray, np.ndarray]:
    """(Relative errors of the energy, errors of the mean anomaly) at step numbers n; row 0 of Q, P is the start."""
    found = [elements(q, p) for q, p in zip(Q, P, strict=True)]
    a, first = found[0]
    rate = mpmath.mpf(h) / a ** mpmath.mpf(1.5)
    late = [mpmath.arg(mpmath.expj(M - first - rate * int(k))) for k, (_, M) in zip(n, found, strict=True)]
    return np.array([float(a / b - 1) for b, _ in found]), np.array([float(x) for x in late])


def pericentres(count: int) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Random pericentres (q, p) of orbits with semi-major axis 1."""
    generator = np.random.default_rng(SEED)
    for e, angle in zip(generator.uniform(*ECCENTRICITIES, count), generator.uniform(0, 2 * np.pi, count), strict=True):
        speed, c, s = ((1 + e) / (1 - e)) ** 0.5, np.cos(angle), np.sin(angle)
        yield ((1 - e) * c, (1 - e) * s), (-speed * s, speed * c)


# -- every method ------------------------------------------------------------------------------------------------------


def steps_of(id: str) -> int:
    """The number of steps that a method runs: the cheaper its step, the more."""
    family, order = BY_ID[id].family, BY_ID[id].order
    if family not in ("parametric", "splitting"):
        return {"schemes_iv_v": DEAR, "trigonometric": IMPLICIT}.get(family, ALONE)
    if not id.startswith(("scheme", "implicit-midpoint", "generating")):
        return EXPLICIT
    return IMPLICIT if order <= 2 else COMPOSED


def every(label: str, h: float, steps: int) -> dict:
    """The growth of a method's round-off on the oscillator, or the reason why there is none."""
    made, method = problem(OSCILLATOR), SUITABLE[label]
    values = {"lam": BESIDE} if "lam" in method.parameters else {}
    row = {"method": method.id, "h": h, "steps": steps, "reason": method.lacks(made.system) or ""}
    if row["reason"] or (known := how(method.id, values)) is None:
        return row | {"reason": row["reason"] or "its exact matrix on the oscillator is not known here"}
    by, M = known
    rows = places(FEWER, FITTED)
    n = np.array(rows) * (steps // FEWER)
    Q, P = run(method.id, values, h, steps, starts(STARTS), FEWER)
    if not (np.isfinite(Q).all() and np.isfinite(P).all()):
        return row | {"reason": "runs end before their last step"}
    with mpmath.workdps(DIGITS):
        energy, phase = (x[:, 1:] for x in exact_maps.errors(M, n, Q[:, rows], P[:, rows]))
    row |= {"by": by, "in lanes": batches.runs_in_lanes(made.system, method)}
    return row | summary(n[1:], h, energy, phase if by == EXACT else None)


def how(id: str, values: dict) -> tuple[str, mpmath.matrix] | None:
    """(`EXACT` or `ENERGY_KEPT`, step matrix whose |w|^2 is used); None if neither it is known nor H is kept."""
    with mpmath.workdps(DIGITS):
        if exact_maps.has_exact_map(id):
            return EXACT, exact_matrix(id, values, H)
        # |w|^2 of an exact rotation is H
        return (ENERGY_KEPT, exact_matrix("deuflhard", {}, H)) if BY_ID[id].energy == "round-off" else None


# -- judging -----------------------------------------------------------------------------------------------------------


def named_step(h: float, digits: int = 10) -> str:
    """A step as text; one slightly off a simple fraction as that fraction times (1 + 2^-40)."""
    return f"{h:.{digits}g}" + (" (1 + 2^-40)" if h == float(f"{h:.3g}") * (1 + 2.0**-40) else "")


@of(CHOSEN, EVERY)
def whole(chosen: pd.DataFrame, all_: pd.DataFrame) -> pd.DataFrame:
    """The growth in every ensemble, or the reason why a method has none."""
    return pd.concat([chosen, all_], ignore_index=True)


@of(whole)
def ensembles(rows: pd.DataFrame) -> pd.DataFrame:
    """The ensembles of both tables, without those by hand, with the column ``at``: the run as text."""
    rows = rows[(rows["kind"] != HAND) & (rows["reason"].astype(object).fillna("") == "")]
    at = [f"{r.label} at h = {named_step(r.h)}" for r in rows.itertuples()]
    return rows.assign(at=at, table=rows["kind"].notna())


def critical(rows: pd.DataFrame) -> float:
    """The largest |mean error|, in standard errors, that chance explains in a table of ensembles.

    If none of the ensembles has a bias, the probability that at least one of them exceeds it is `CHANCE`.
    """
    from scipy import stats

    each = 1 - (1 - CHANCE) ** (1 / len(rows))
    return float(stats.t.ppf(1 - each / 2, rows["starts"].min() - 1))


def overtaken(rows: pd.DataFrame) -> pd.Series:
    """After how many steps a bias, growing as n, is as large as the random walk, growing as n^(1/2)."""
    return rows["steps"] * rows["starts"] / rows[MEAN] ** 2


@of(ensembles)
def means(rows: pd.DataFrame) -> pd.DataFrame:
    """The ensembles with the ``limit`` of a mean error, in standard errors, and a ``note``; the largest mean first.

    Runs at simple fractions are left out: their round-off repeats itself.
    """
    rows = rows[rows[MEAN].notna() & (rows["kind"] != FRACTION)].sort_values(MEAN, key=lambda x: -x.abs())
    limit = rows["table"].map({name: critical(part) for name, part in rows.groupby("table")})
    leads = overtaken(rows).map(lambda n: f"leads after {number(n, 2)} steps")
    return rows.assign(limit=limit, note=leads.mask(rows["by"] == ENERGY_KEPT, "an offset"))


def faster(rows: pd.DataFrame) -> pd.Series:
    """True where the energy error surely grows faster than n^(1/2)."""
    return rows["energy low"] > ENERGY + ABOVE


def controls(rows: pd.DataFrame) -> pd.Series | None:
    """True for each kind of control that confirms the explanation of the drift; None if one was not measured.

    The drift must vanish slightly off the fraction, persist with exact products alone, and vanish if velocity and force
    see the whole state; plain sums must lose more.
    """
    rows = rows[rows["energy exponent"].notna()]
    kinds = rows["label"].where(rows["kind"] == HAND, rows["kind"])
    if {*BY_HAND, ASIDE_OF} - {*kinds}:
        return None
    drifts, lossy = faster(rows).groupby(kinds).any(), (rows["in units"] > UNITS).groupby(kinds).all()
    confirmed = {PLAIN: lossy[PLAIN], ASIDE_OF: not drifts[ASIDE_OF], HALF: drifts[HALF], WHOLE: not drifts[WHOLE]}
    return pd.Series(confirmed, dtype=bool)


@of(CHOSEN)
def _drift(rows: pd.DataFrame) -> str:
    near = rows[faster(rows) & (rows["kind"] == FRACTION)].nlargest(1, "energy exponent")
    return "".join(f"; it drifts next to fractions such as h = {named_step(h)}" for h in near["h"])


# -- what is shown -----------------------------------------------------------------------------------------------------


@picture(
    CURVES, "extremes-growth", "growth of round-off",
    f"Round-off of {STARTS} starts, on the oscillator where nothing else is said: Brouwer's law and what is measured. "
    "Only where the frequency depends on the energy does the phase's grow as n^1.5; next to fractions of small "
    "denominators it drifts.",
)  # fmt: skip
def draw(rows: pd.DataFrame) -> style.Figure:
    """The rms round-off errors of energy and phase over the number of steps."""
    keys = [*zip(rows["label"], rows["h"], rows["steps"], strict=True)]
    names = [f"{label}, h = {named_step(h, 3)}" for label, h, _ in keys]
    rows = rows.assign(run=names, curve=[RUNS.get(key, {}).get("curve") for key in keys])
    rows, laws = rows.dropna(subset="curve").sort_values("curve"), {"energy": ENERGY, "phase": PHASE}
    of_each = [(f"{name}: dotted, ε h n^{law:g}", rows.assign(rms=rows[name])) for name, law in laws.items()]
    of_run = style.curves("run", "n", "rms", most=9)
    figure = style.row(of_each, of_run, 3.8, "steps", "rms error over the starts", legend=2, grid=False)
    n = np.array([rows["n"].min(), rows["n"].max()], float)
    for axes, law in zip(figure.axes, laws.values(), strict=True):
        axes.loglog(n, EPS * STEP * n**law, color=style.GREY, linestyle=":")
    return figure


def _exponents(rows: pd.DataFrame, name: str) -> list[str]:
    found = rows[[f"{name} {part}" for part in ("exponent", "low", "high")]].itertuples(index=False)
    return ["" if pd.isna(value) else f"{value:.2f} [{low:.2f}, {high:.2f}]" for value, low, high in found]


@of(whole)
def _table(known: pd.DataFrame) -> Table:
    order = known["kind"].map({FRACTION: 0, ASIDE_OF: 1, HAND: 2}).fillna(3)
    known = known.assign(order=order)[known["energy low"].notna()]
    first = known[known["order"] < 3].sort_values(["order", "label", "h"])
    # Worst first: by how far the exponent is above the law's, then by the size of the error.
    rest = known[known["order"] == 3].assign(above=lambda t: (t["energy low"] - ENERGY).clip(lower=0))
    shown = pd.concat([first, rest.sort_values(["above", "in units"], ascending=False)]).head(SHOWN)
    columns = {
        "run": shown["label"],
        "h": shown["h"].map(named_step),
        "steps": shown["steps"].astype(float),
        "energy ~ n^": _exponents(shown, "energy"),
        "phase ~ n^": _exponents(shown, "phase"),
        "error / eps h n^(1/2)": shown["in units"],
        "mean a step": shown["bias per step"],
        "in standard errors": shown[MEAN],
    }
    caption = (
        "Fractions of small denominators, steps beside them, controls by hand, then of all other ensembles the worst. "
        "Powers of n with 95 % intervals; the rms error of the energy at the end in units of eps h n^(1/2); the mean "
        "change of the energy a step, and in units of its standard error."
    )
    return Table(pd.DataFrame(columns), caption)


#: The claim on the energy; the page `extremes` makes it, too.
LAW = Claim(
    "The energy's round-off grows no faster than n^(1/2), Brouwer's law",
    ensembles, f"`energy low` <= {ENERGY + ABOVE}", rows="`energy low` == `energy low`", unit="ensembles",
    where="{at}: n^{energy exponent:.2f}", names=3,
)  # fmt: skip
STUDY = Study(
    id="extremes-round-off",
    place=200,
    question="How does round-off grow over long times?",
    answer="In {energy} ensembles the energy's round-off grows no faster than n^(1/2) after n steps, Brouwer's "
    "law{drift}.",
    setting=(
        "H = (p² + q²) / 2: a symplectic step is a matrix M of trace 2 cos θ; w = M_pq q + (e^{iθ} - M_qq) p turns by "
        "θ and keeps |w|.",
        f"An ensemble: {STARTS} seeded starts; |w|² and arg w in {DIGITS} digits, M from the coefficients and the "
        "double h, so that what changes is round-off.",
        "Brouwer 1937: unbiased rounding lets the energy's error grow as n^(1/2), the phase's as n^(3/2) where the "
        "period depends on the energy.",
        "Chosen methods, also at fractions of small denominators (h = 0.01 and 0.1, λ = 1/3) and beside them (h (1 + "
        f"2^-40), λ = 0.3333333333). Every method: h = {H:g}, {DEAR} to {EXPLICIT} steps, fewer for dear ones; for "
        "methods that keep H, the error of H.",
        "Controls by hand: Störmer–Verlet by plain sums; with exact products; with exact products and the state's lost "
        "digits seen by velocity and force.",
    ),
    runs=(
        Runs(
            CHOSEN, growth,
            [dict(zip(("label", "h", "steps"), run, strict=True)) for run in RUNS], needs=_needs, more=(CURVES,),
        ),
        Runs(EVERY, every, [{"label": name, "h": H, "steps": steps_of(m.id)} for name, m in SUITABLE.items()],
             needs=lambda label, **_: (SUITABLE[label], ProblemKey(OSCILLATOR))),
    ),
    claims={
        "energy": LAW,
        "phase": Claim(
            "The phase's round-off grows no faster than n^(3/2)",
            ensembles, f"`phase low` <= {PHASE + ABOVE}", rows="`phase low` == `phase low`", unit="ensembles",
            where="{at}: n^{phase exponent:.2f}", names=3,
        ),
        "size": Claim(
            "The energy's round-off is no larger than compensated sums allow",
            ensembles, "`in units`", at_most(UNITS), unit="eps h n^(1/2)", where="{at}, {steps:.3g} steps",
        ),
        "bias": Claim(
            "Away from simple fractions, round-off has no bias",
            means, f"abs(`{MEAN}`) > limit", NONE, unit="ensembles", where="{at} ({note})", names=2,
        ),
        "controls": Claim(
            "Controls drift, or do not, as the rounding of the state explains",
            CHOSEN, controls, unit="controls", names=4, fault=True,
        ),
    },
    numbers={"drift": _drift},
    shown=_table,
    whole=whole,
    tables=(CHOSEN, EVERY),
    limits=(
        f"A power fails where its 95 % interval begins more than {ABOVE:g} above the law's; a mean where Student's law "
        f"gives it a probability of less than {CHANCE:.0%} over all ensembles of its table.",
        "The drift at fractions of small denominators is a bias: the state's rounded-off digits take few values there, "
        "whose mean is not 0. The controls show it; another step avoids it.",
        "A bias grows as n and leads over a random walk after as many steps as make its mean as large; for a method "
        "that keeps H the mean is an offset.",
        "Coefficients that are rounded to doubles make another symplectic map: the phase has a part linear in n, which "
        "is no round-off of the run.",
        "The oscillator's force is exact in doubles; a force that rounds by itself may hide the drift.",
        "Methods that are neither symplectic nor keep the energy drift by truncation, not by round-off: they have no "
        "ensemble here.",
        f"The runs of every method are short: a power is fitted over a factor {FEWER} in n, at h = {H:.3g}; the phase "
        "is not judged where the step map is not known exactly.",
    ),
    within="extremes",
    listed=False,
)  # fmt: skip
