"""References by heyoka's Taylor series in long double, quadruple precision, or any number of bits.

All runs start from the same doubles, and every number of the system is exact in each precision (`translate`).
The uncertainty of a long double run is its distance from the quadruple one.

Source: F. Biscani, D. Izzo, Revisiting high-order Taylor methods for astrodynamics and celestial mechanics,
Mon. Not. R. Astron. Soc. 504 (2021) 2614-2628.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from . import watch
from .translate import translate

if TYPE_CHECKING:
    from phasebench.integrators.compile.printing import Program
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Decimals of a long double as text: 21 determine it, the rest keep the text's own error out of comparisons.
DIGITS = 25
#: Right-hand sides with more components are compiled in heyoka's compact mode.
COMPACT = 12
#: Largest number of steps: near a collision steps shrink without end.
STEP_LIMIT = 10_000_000


@dataclass(frozen=True)
class Bits:
    """The type of numbers with ``bits`` mantissa bits (heyoka's `real`, MPFR), callable like other number types."""

    bits: int

    @property
    def __name__(self) -> str:
        return f"{self.bits}-bit"

    @property
    def digits(self) -> int:
        """A number of decimal digits that is enough to write a number of this precision without loss."""
        return int(self.bits * 0.302) + 10

    def __call__(self, x: Any) -> Any:
        """Convert x (a double, an integer, a number of another precision or a text) to this precision."""
        import heyoka as hy

        return hy.real(x, prec=self.bits)


class ReferenceFailed(RuntimeError):
    """Raised if a reference integration does not reach its end; the message has the time it reached."""


@dataclass(frozen=True)
class Reference:
    """A trajectory with its uncertainty.

    Attributes
    ----------
    t : array (n,), the times, as given
    q, p : arrays (n, d), the long double run rounded to double
    q_text, p_text : arrays (n, d) of decimal strings that determine the long double run
    uncertainty : array (n,), the max norm over (q, p) of long double minus quadruple run, without rounding to double;
        NaN if not certified
    rounding : array (n,), the max norm over (q, p) of the rounding of the long double run to double
    """

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    q_text: np.ndarray = field(repr=False)
    p_text: np.ndarray = field(repr=False)
    uncertainty: np.ndarray
    rounding: np.ndarray


def equations(system: PartitionedSystem, fp: type | Bits, program: Program | None = None) -> list:
    """The equations of motion of ``system`` for heyoka, [(variable, right-hand side), ...], q before p.

    ``program`` has the right-hand sides [q', p']; ``system.shared`` if None.
    """
    import heyoka as hy

    variables = {x: hy.expression(f"x{i}") for i, x in enumerate((*system.q, *system.p))}
    known = dict(variables)
    definitions, results = program or system.shared
    for symbol, e in definitions:
        known[symbol] = translate(e, known, fp)
    sides = (translate(e, known, fp) for vector in results for e in vector)
    return list(zip(variables.values(), sides, strict=True))


def integrator(system: PartitionedSystem, fp: type | Bits, tol: float | str | None = None) -> Any:
    """Make heyoka's integrator of ``system`` in the precision ``fp`` (float, numpy.longdouble, heyoka.real128, `Bits`).

    ``tol`` is the tolerance of the Taylor series; None for heyoka's default.
    """
    import heyoka as hy

    motion = equations(system, fp)
    many = isinstance(fp, Bits)
    kind = hy.real if many else fp
    options = {} if tol is None else {"tol": fp(tol)}
    options |= {"prec": fp.bits} if many else {}
    return hy.taylor_adaptive(
        motion,
        np.array([fp(0.0)] * len(motion), dtype=kind),
        fp_type=kind,
        compact_mode=many or len(motion) > COMPACT,  # unrolled calls of MPFR compile for minutes
        **options,
    )


def start(ta: Any, fp: type | Bits, q0: Iterable[float], p0: Iterable[float]) -> None:
    """Reset heyoka's integrator ``ta``, of number type ``fp``, to time 0 and the state q0, p0 (doubles)."""
    ta.time = fp(0.0)
    ta.state[:] = [fp(float(x)) for x in (*q0, *p0)]


def propagate(
    ta: Any, grid: Sequence[Any] | np.ndarray, run: str = "run", ends: list[float] | None = None
) -> tuple[np.ndarray, int, str | None]:
    """Integrate with heyoka's integrator ``ta`` to the times of ``grid``: (rows, steps, failure).

    The first time is the one at which ``ta`` stands; the times are numbers of its type.  ``rows`` are the states at the
    times that were reached, ``steps`` is the number of steps, and ``failure`` the reason if the end was not reached,
    else None.  The times at which steps end are appended to ``ends``; ``run`` is the name of the run in progress
    reports.  Raises `watch.TooLong` if a time limit is set and cannot be met.
    """
    said = _callback_options(run, float(grid[-1]), ends)
    if len(grid) == 2:  # the same steps, up to a fifth faster since no polynomials for rows are computed
        first = ta.state.copy()
        outcome, _, _, steps, _, _ = ta.propagate_until(grid[1], max_steps=STEP_LIMIT, **said)
        rows = np.stack([first, ta.state] if failure(outcome) is None else [first])
    else:
        outcome, _, _, steps, _, rows = ta.propagate_grid(grid, max_steps=STEP_LIMIT, **said)
    return rows, steps, failure(outcome)


def failure(outcome: Any) -> str | None:
    """The reason why a propagation ended early, from heyoka's ``taylor_outcome``; None if it reached its end."""
    import heyoka as hy

    why = {
        hy.taylor_outcome.time_limit: None,
        hy.taylor_outcome.err_nf_state: "the state is no longer finite",
        hy.taylor_outcome.step_limit: f"{STEP_LIMIT} steps did not reach the end",
    }
    return why.get(outcome, f"heyoka stopped with {outcome}")


def _callback_options(run: str, t_end: float, ends: list[float] | None = None) -> dict:
    """Keyword arguments for heyoka that make it report the time of each step to `watch` and to ``ends``."""
    if ends is None and not watch.is_watched():
        return {}

    def callback(ta: Any) -> bool:
        t = float(ta.time)
        watch.report_time(run, t, t_end)
        if ends is not None:
            ends.append(t)
        return True

    return {"callback": callback}


def extended_types() -> tuple[type, type]:
    """The types of long double and quadruple precision; raises ReferenceFailed if the platform lacks one."""
    import heyoka as hy

    if np.finfo(np.longdouble).nmant < 63 or not hasattr(hy, "real128"):
        raise ReferenceFailed("references need an extended long double and heyoka's real128; this platform lacks one")
    return np.longdouble, hy.real128


def states(
    system: PartitionedSystem,
    fp: type | Bits,
    q0: Iterable[float],
    p0: Iterable[float],
    times: Iterable[float],
    tol: float | str | None = None,
) -> np.ndarray:
    """Integrate from the doubles q0, p0: the states at ``times``, rows (n, 2 d) of type ``fp``.

    ``times`` (n,) are increasing and positive; ``tol`` is the tolerance of the series, None for heyoka's default.

    Raises
    ------
    ReferenceFailed
        If the run does not reach the end; the message has the time it reached.
    """
    import heyoka as hy

    ta = integrator(system, fp, tol)
    start(ta, fp, q0, p0)
    grid = np.array([fp(0.0)] + [fp(float(t)) for t in times], dtype=hy.real if isinstance(fp, Bits) else fp)
    rows, _, failure = propagate(ta, grid, f"{fp.__name__} run")
    if failure is None and not all(np.isfinite(float(x)) for x in rows[-1]):
        failure = "the state is no longer finite"
    if failure is not None:
        raise ReferenceFailed(f"the {fp.__name__} run stopped at t = {float(ta.time):.6g}: {failure}")
    return rows[1:]


def step_ends(
    system: PartitionedSystem, fp: type | Bits, q0: Iterable[float], p0: Iterable[float], t_end: float
) -> list[float]:
    """The times at which the steps of an integration to ``t_end`` from the doubles q0, p0 end, rounded to double.

    ``fp`` is the number type in which it is made, as for `integrator`.
    """
    ta = integrator(system, fp)
    start(ta, fp, q0, p0)
    ends: list[float] = []
    propagate(ta, [fp(0.0), fp(float(t_end))], f"{fp.__name__} run", ends)
    return ends


def reference(
    problem: Any,
    times: Sequence[float] | np.ndarray,
    certify: bool = True,
    q0: Sequence[float] | np.ndarray | None = None,
    p0: Sequence[float] | np.ndarray | None = None,
) -> Reference:
    """The trajectory of ``problem`` at ``times`` in long double, with its uncertainty from quadruple precision.

    Parameters
    ----------
    problem : a problem with ``system`` (any partitioned system), ``q0`` and ``p0``
    times : array (n,), increasing, from 0 or later
    certify : run quadruple precision too; without it the uncertainty is NaN
    q0, p0 : arrays (d,), the initial state if not the problem's

    Raises
    ------
    ReferenceFailed
        If a run does not reach the end; the message has the time it reached.
    ValueError
        For times that do not increase or are negative.
    """
    times = np.asarray(times, dtype=float).reshape(-1)
    if not len(times) or not np.isfinite(times).all() or times[0] < 0 or (np.diff(times) <= 0).any():
        raise ValueError("times must be finite, increasing and start at 0 or later")
    q0, p0 = (problem.q0 if q0 is None else q0), (problem.p0 if p0 is None else p0)
    long, quad = extended_types()
    later = times[times > 0]
    first = np.array([[long(float(x)) for x in (*q0, *p0)]] * (len(times) - len(later)), dtype=long)
    rows = np.vstack([first.reshape(-1, 2 * len(q0)), states(problem.system, long, q0, p0, later)])
    uncertainty = np.full(len(times), np.nan)
    if certify:
        uncertainty[: len(first)] = 0.0
        exact = states(problem.system, quad, q0, p0, later)
        for i, (x, y) in enumerate(zip(rows[len(first) :], exact, strict=True), start=len(first)):
            uncertainty[i] = max(abs(float(quad(a) - b)) for a, b in zip(x, y, strict=True))
    doubles = rows.astype(float)
    rounding = np.abs(rows - doubles).max(axis=1).astype(float)
    text = np.array([[np.format_float_scientific(x, precision=DIGITS, unique=False) for x in row] for row in rows])
    d = len(q0)
    return Reference(times, doubles[:, :d], doubles[:, d:], text[:, :d], text[:, d:], uncertainty, rounding)
