r"""Brouwer's law: the growth of round-off over long times, on the oscillator, where the step map is known exactly.

A linear symplectic step y -> M y with trace 2 cos(theta) turns :math:`w = M_{pq} q + (e^{i\theta} - M_{qq}) p` by
theta: |w|^2 is kept exactly and arg w grows by theta a step.  M is computed in extended precision from the method's
coefficients and the double h; any other change of |w| and arg w in a run is round-off.  With unbiased rounding the
energy's error grows as n^(1/2), from :math:`\epsilon h \sqrt n` with compensated increments (epsilon the unit
round-off), and the phase's as n^(3/2) where the frequency depends on the energy (Brouwer 1937); here it does not, see
`brouwer_kepler`.  The control is Stormer-Verlet with plain sums.
If h, or the parameter lambda of Scheme I, is close to a fraction with a small denominator (h = 0.01 and 0.1, lambda =
1/3), the rounded-off parts of the state, which velocity and force do not see, take few values, whose mean is not zero:
the energy drifts.  The same runs slightly off the fraction, and those of `brouwer_controls`, confirm this explanation.

Source: D. Brouwer, Astron. J. 46 (1937) 149-153; Hairer, Lubich, Wanner, Geometric Numerical Integration (2006),
VIII.5.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.ensemble import integrate_ensemble

from . import brouwer_controls as controls
from . import exact_maps
from .exact_maps import exact_matrix
from .methods import record

PROBLEM, CONTROL = "harmonic-oscillator", controls.PLAIN
#: Number of starts, their seed, rows of a run, points in the fit of an exponent (each at twice the time), resamples.
STARTS, SEED, ROWS, FITTED, DRAWN = 100, 1937, 1024, 7, 400
#: Step sizes: without a pattern, a power of two, two simple fractions, and a factor that moves slightly off them.
PLAIN, BINARY, DECIMAL, TENTH = 0.0123456789, 2.0**-7, 0.01, 0.1
ASIDE = 1 + 2.0**-40
#: lambda = 1/3, and a value slightly off it.
THIRD, BESIDE = "1/3", "0.3333333333"
#: Kinds of runs.
USUAL, FRACTION, ASIDE_OF, HAND = "usual", "fraction", "beside a fraction", "by hand"
UNBIASED = (USUAL, ASIDE_OF)
DIGITS, PLACES = 50, 160
EPS = 2.0**-53
#: Floor of a mean square error, so that its logarithm is finite.
TINY = 1e-40
MOST, MANY, SOME, FEW = 10_240_000, 5_120_000, 1_024_000, 512_000
#: (method, parameters, h, steps): one method of each family whose step is a symplectic matrix, then simple fractions
#: and values slightly off them; each run takes a few seconds.
RUNS = (
    ("stormer-verlet", {}, PLAIN, MOST),
    ("stormer-verlet", {}, BINARY, MANY),
    ("symplectic-euler-p", {}, PLAIN, MANY),
    ("pefrl", {}, PLAIN, 2 * SOME),
    ("kahan-li-8", {}, PLAIN, FEW),
    ("blanes-moan-srkn6b", {}, PLAIN, SOME),
    ("implicit-midpoint", {}, PLAIN, SOME),
    ("scheme-i", {"lam": "-1"}, PLAIN, SOME),
    ("scheme-iii", {"lam": "-1"}, PLAIN, SOME),
    ("gauss-2", {}, PLAIN, FEW),
    ("gauss-4", {}, PLAIN, FEW),
    ("lobatto-iiia-iiib-3", {}, PLAIN, FEW),
    ("avf", {}, PLAIN, FEW),
    ("deuflhard", {}, PLAIN, SOME),
    ("stormer-verlet", {}, DECIMAL, MOST),
    ("stormer-verlet", {}, DECIMAL * ASIDE, MANY),
    ("scheme-i", {"lam": THIRD}, PLAIN, SOME),
    ("scheme-i", {"lam": BESIDE}, PLAIN, SOME),
    ("gauss-2", {}, TENTH, FEW),
    ("gauss-2", {}, TENTH * ASIDE, FEW),
    (controls.HALF, {}, DECIMAL, 2 * SOME),
    (controls.WHOLE, {}, DECIMAL, 2 * SOME),
    (CONTROL, {}, PLAIN, MANY),
)
#: Steps of the single long run.
LONG = 102_400_000
TABLES = ("extremes_growth", "extremes_growth_curves")


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each ensemble of runs and one for the long run; none if ``quick``."""
    runs = [*RUNS, ("stormer-verlet", {}, PLAIN, LONG)]
    return [] if quick else [_cell(*run) for run in runs]


def _cell(id: str, values: dict, h: float, steps: int) -> Cell:
    method_ = record(_method(id))
    needs = content(
        "growth",
        id,
        method_,
        values,
        h,
        steps,
        ProblemKey(PROBLEM),
        code=[__name__, exact_maps.__name__, controls.__name__],
    )
    key = {"label": label(id, values), "h": h, "steps": steps}
    return Cell("extremes", TABLES, key, measure_rows, (id, values, h, steps), needs, frozenset({id}))


def _method(id: str) -> str:
    """Return the id of the method whose step matrix applies: for the hand-written controls that of Stormer-Verlet."""
    return "stormer-verlet" if id in controls.KINDS else id


def label(id: str, values: dict) -> str:
    """Format a method's id with its parameters, as "scheme-i(lam=1/3)"."""
    return f"{id}({', '.join(f'{k}={v}' for k, v in values.items())})" if values else id


def _kind(id: str, values: dict, h: float) -> str:
    """Classify a run by its method ``id``, the values of the method's parameters (such as lambda) and the step h.

    Returns `HAND` for a control written by hand, `FRACTION` if h or lambda is a simple fraction, `ASIDE_OF` if it is
    slightly off one, else `USUAL`.
    """
    if id in controls.KINDS:
        return HAND
    if h in (DECIMAL, TENTH) or values.get("lam") == THIRD:
        return FRACTION
    return ASIDE_OF if h in (DECIMAL * ASIDE, TENTH * ASIDE) or values.get("lam") == BESIDE else USUAL


def errors(M: mpmath.matrix, n: np.ndarray, Q: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute (relative errors of |w|^2, errors of the phase arg w) at step numbers n, from the states of runs.

    The arithmetic is exact, in integers times 2^-`PLACES`; only M and theta are rounded.

    Parameters
    ----------
    M : matrix of a step, in the working precision
    n : m step numbers
    Q, P : states, arrays (..., m), whose first column is the start

    Returns
    -------
    tuple
        Two arrays (..., m); the phase in radians
    """
    cosine = (M[0, 0] + M[1, 1]) / 2
    turn = mpmath.mpc(cosine, mpmath.sqrt(1 - cosine**2))
    theta, by_p = mpmath.arg(turn), turn - M[0, 0]
    back = [mpmath.expj(-theta * int(k)) for k in n]
    Q, P = _integers(np.asarray(Q, float)), _integers(np.asarray(P, float))
    x, y = _integer(M[1, 0]) * Q + _integer(by_p.real) * P, _integer(by_p.imag) * P
    first_x, first_y = x[..., :1], y[..., :1]
    first = first_x * first_x + first_y * first_y
    energy = (x * x + y * y - first) / first
    c, s = (np.array([_integer(part(z)) for z in back], dtype=object) for part in (mpmath.re, mpmath.im))
    along, across = x * first_x + y * first_y, y * first_x - x * first_y
    whole = first << PLACES
    phase = np.arctan2(*(((a * c + b * s) / whole).astype(float) for a, b in ((across, along), (along, -across))))
    return energy.astype(float), phase


def _integer(x: mpmath.mpf) -> int:
    """Return 2^`PLACES` x, rounded to an integer."""
    return int(mpmath.nint(mpmath.ldexp(x, PLACES)))


#: 2^`PLACES` x for an array of doubles; exact if no nonzero one is below 2^-100.
_integers = np.frompyfunc(lambda x: int(math.ldexp(x, PLACES)), 1, 1)


def starts_of(count: int) -> np.ndarray:
    """Draw random starts (q, p), array (count, 2): uniform in angle, amplitudes from 1/2 to 3/2."""
    generator = np.random.default_rng(SEED)
    angle, size = generator.uniform(0, 2 * np.pi, count), generator.uniform(0.5, 1.5, count)
    return np.column_stack([size * np.cos(angle), size * np.sin(angle)])


def runs(
    id: str, values: dict, h: float, steps: int, starts: np.ndarray, rows: int = ROWS
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the oscillator from all starts (q, p), array (n, 2): (Q, P), arrays (n, rows + 1).

    Their columns are the start and ``rows`` later states, equally spaced over the ``steps`` steps of length h;
    ``values`` are the method's parameters.  Methods run as an ensemble, the hand-written controls orbit by orbit.
    """
    if id in controls.KINDS:
        run = controls.runner(id, h, rows)
        Q, P = zip(*(run(q, p, steps) for q, p in starts), strict=True)
        return np.array(Q), np.array(P)
    options = {"h": h, "steps": steps, "parameters": values, "save_every": steps // rows, "threads": 1}
    made = integrate_ensemble(problem(PROBLEM), id, starts[:, :1], starts[:, 1:], **options)
    return made.Q[:, :, 0], made.P[:, :, 0]


def measure_rows(id: str, values: dict, h: float, steps: int) -> Rows:
    """Integrate the oscillator from many starts: a row on the growth of round-off, and rows of rms errors over n.

    n is the number of steps; ``values`` are the method's parameters.  Returns the rows by table name, as in `TABLES`.
    """
    rows = [0, *(ROWS // 2**k for k in range(9, -1, -1))]
    n = np.array(rows) * (steps // ROWS)
    starts = starts_of(STARTS if steps < LONG else 1)
    Q, P = runs(id, values, h, steps, starts)
    with mpmath.workdps(DIGITS):
        found = errors(exact_matrix(_method(id), values, h), n, Q[:, rows], P[:, rows])
    energy, phase = (x[:, 1:] for x in found)
    row = {"label": label(id, values), "h": h, "steps": steps, "kind": _kind(id, values, h)}
    row |= summary(n[1:], h, energy, phase)
    return {TABLES[0]: [row], TABLES[1]: curves(row, n[1:], energy, phase)}


def summary(n: np.ndarray, h: float, energy: np.ndarray, phase: np.ndarray | None = None) -> dict:
    """Summarize energy and phase errors by round-off at step numbers n (m,): the columns of their rms, bias and growth.

    ``energy`` and ``phase`` are arrays (starts, m); ``phase`` may be None.
    """
    rms = float(np.sqrt((energy[:, -1] ** 2).mean()))
    row = {"starts": len(energy), "energy rms": rms}
    if phase is not None:
        row["phase rms"] = float(np.sqrt((phase[:, -1] ** 2).mean()))
    row["in units"] = rms / float(EPS * h * np.sqrt(n[-1]))
    if len(energy) > 1:
        mean, error = energy[:, -1].mean(), energy[:, -1].std(ddof=1) / np.sqrt(len(energy))
        row |= {"bias per step": float(mean / n[-1]), "bias in its errors": float(mean / error) if error else 0.0}
        for name, values in (("energy", energy), ("phase", phase)):
            if values is not None and values.any():
                row |= dict(zip((f"{name} exponent", f"{name} low", f"{name} high"), growth(n, values), strict=True))
    return row


def curves(row: dict, n: np.ndarray, energy: np.ndarray, phase: np.ndarray) -> list[dict]:
    """Make rows of the rms energy and phase errors at each step number in ``n``, identified by the run in ``row``."""
    key = {name: row[name] for name in ("label", "h", "steps")}
    each = zip(n, np.sqrt((energy**2).mean(0)), np.sqrt((phase**2).mean(0)), strict=True)
    return [key | {"n": int(k), "energy": float(e), "phase": float(f)} for k, e, f in each]


def growth(n: np.ndarray, errors_: np.ndarray) -> tuple[float, float, float]:
    """Fit the exponent of n in the rms error: (exponent, low, high), with a 95 % interval by bootstrap over the starts.

    Parameters
    ----------
    n : array (m,), rising; the last `FITTED` are fitted
    errors_ : array (starts, m)
    """
    x, generator = np.log(np.asarray(n[-FITTED:], float)), np.random.default_rng(SEED)

    def fit(sample: np.ndarray) -> float:
        size = np.maximum((sample[:, -FITTED:] ** 2).mean(axis=0), TINY)
        return float(np.polyfit(x, 0.5 * np.log(size), 1)[0])

    drawn = [fit(errors_[generator.integers(0, len(errors_), len(errors_))]) for _ in range(DRAWN)]
    return fit(errors_), *map(float, np.quantile(drawn, (0.025, 0.975)))
