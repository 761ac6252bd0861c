r"""Determine how a run ended: whether its rows (stored states) conserve the energy, and whether it met a singularity.

Energy and orbit.  H is a sum of terms; M(y) is the sum of their absolute values at y (`PartitionedSystem.scale`).  The
rows :math:`y_0, ..., y_n` are taken not to be the orbit (status "inaccurate" or "unstable") if

.. math::
    |H(y_i) - H(y_0)| > \tfrac12\,\max\bigl(M(y_i), \overline M\bigr)

for some i, with :math:`\overline M` the mean over the rows after the first.  At such a row the error is as large as
the terms of H, so that kinetic and potential energy there are those of another motion, whatever the method promises; on
an oscillator H has doubled or halved.  M is taken at the same row: in a blow-up it grows with the error, and at a close
encounter, where the terms are large and cancel, an error that is small against them passes there, but is seen in later
rows.  The mean prevents that an accurate orbit is rejected at a point where all terms vanish (a saddle with H = 0).
M(y_0) is not used: an orbit that starts at a pericentre would never be rejected.

Growth (`grows`).  The rows are "unstable" where the error grows, else "inaccurate": a leapfrog on an oscillator has an
error of many times H at :math:`h\omega = 1.99`, and is bounded for all times; at 2.01 the error grows without end.
The criterion uses the means of the error's size over four equal parts of the run: the error grows if each of the last
two means is larger than the mean before it by the factor `RISE`.  For exponential growth and for a linear drift the
last mean is at least 1.4 times the mean before it, for a random walk 1.18 times; for a bounded error the two are equal.
An error of `BLOWN` times the size of the terms at the start has grown, whatever follows.  If there are too few rows
for four means, the error has grown if it exceeds `BLOWN_BETWEEN` times that size.  An error that falls, as with the
implicit Euler method, does not grow.

A run that conserves the energy passes however far the state goes: an escape may be the true motion.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .compile.codegen import value_kind
from .statuses import COLLISION as COLLISION
from .statuses import DIVERGED as DIVERGED
from .statuses import INACCURATE, OK, UNSTABLE
from .statuses import INVALID as INVALID
from .statuses import NO_ROOT as NO_ROOT
from .statuses import NOT_CONVERGED as NOT_CONVERGED
from .statuses import SKIPPED as SKIPPED
from .statuses import TIMEOUT as TIMEOUT

if TYPE_CHECKING:
    from .systems.hamiltonian import PartitionedSystem
    from .values.kinds import Number

#: An energy error of this share of the size of H's terms is another motion's.
LOST = 0.5
#: One of this share is named in the reason of a run that is ok.
NOTED = 0.1
#: A mean that is larger than the one before by this factor rises; so many rows make four means.
RISE, PARTED = 1.3, 12
#: An energy error of so many times the size of H's terms at the start has grown; and where there are few rows.
BLOWN, BLOWN_BETWEEN = 1e6, 1e3
#: A motion that has grown by the second factor and kept the energy to the first share until then may escape.
KEPT, GROWN = 1e-3, 10.0
#: A motion whose direction misses a singularity by less than this angle meets it.
HEAD_ON = 1e-7


class Outcome(NamedTuple):
    """The status of a run, one word, and the reason as a sentence."""

    status: str
    reason: str


class SolverFailure(NamedTuple):
    """What is told of an implicit step that was not solved: by which solver, and what may help but a smaller h."""

    what: str
    advice: str


UNSOLVED = SolverFailure("neither the fixed point nor Newton's method solves the stage equation", "")
IN_A_BAND = SolverFailure("Newton's method in a band does not solve the stage equation", "")
ON_CONSTRAINTS = SolverFailure("no multipliers were found that keep the constraints in the step", "")
ADVISED = UNSOLVED._replace(advice=", or try solver='banded' where variables act on few others, as in a lattice")


def solver_failure(family: str, d: int) -> SolverFailure:
    """The message on an unsolved stage equation of a family."""
    if family == "banded":
        return IN_A_BAND
    if family in ("rattle", "manifold"):
        return ON_CONSTRAINTS
    return ADVISED if family == "parametric" and value_kind(d) == "array" else UNSOLVED


class EnergyError(NamedTuple):
    """The energy error of each row (stored state) of a trajectory.

    The size of H's terms is the sum of their absolute values.

    Attributes
    ----------
    size : array (n,), |H - H_0|
    share : array (n,), ``size`` divided by the size of H's terms: in the row, or its mean over the rows after the
        first, whichever is larger
    sofar : array (n,), the same with the mean over the rows up to this one, which shows when an error became large
    first : the size of H's terms in the first row
    """

    size: np.ndarray
    share: np.ndarray
    sofar: np.ndarray
    first: float


def energy_error(system: PartitionedSystem, Q: np.ndarray, P: np.ndarray) -> EnergyError | None:
    """The energy error of finite rows Q, P, each (n, d), relative to the first row's energy; None if it is small."""
    H = system.energies(Q, P)
    size = sizes(H)
    if len(H) < 2 or (size <= KEPT * np.abs(H - system.constant)).all():  # M is no less
        return None
    M = np.minimum(system.scale(Q, P), np.finfo(float).max)
    with np.errstate(over="ignore"):
        sofar = np.append(M[0], np.cumsum(M[1:]) / np.arange(1, len(M)))
    return EnergyError(size, _share(size, units(M)), _share(size, np.maximum(M, sofar)), float(M[0]))


def sizes(H: np.ndarray) -> np.ndarray:
    """|H - H_0| in each row, from energies H of shape (..., rows) whose first row has H_0."""
    size = np.abs(H - H[..., :1])
    size[size < np.finfo(float).tiny] = 0.0  # numbers that small have no digits
    return size


def units(M: np.ndarray) -> np.ndarray:
    """The unit of the energy error in each row: the larger of M in this row and of M's mean over all but the first.

    M, of shape (..., rows) and finite, is the size of H's terms.
    """
    rest = M[..., 1:]
    mean = (rest / max(1, rest.shape[-1])).sum(axis=-1, keepdims=True)  # a sum of large numbers must not overflow
    return np.maximum(M, mean)


def flag_energy_errors(H: np.ndarray, M: np.ndarray) -> np.ndarray:
    """True in rows whose energy H is not finite, or off the first row's by a tenth of `units`; arrays (..., rows)."""
    with np.errstate(all="ignore"):
        M = np.minimum(M, np.finfo(float).max)
        return ~(np.isfinite(H) & (_share(sizes(H), units(M)) <= NOTED))


def _share(error: np.ndarray, size: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(error > 0, error / size, 0.0)


def judge(
    system: PartitionedSystem, t: np.ndarray, Q: np.ndarray, P: np.ndarray, advice: str = "take a smaller h"
) -> Outcome:
    """The status of a complete run, "ok", "inaccurate" or "unstable", and its reason, from the energy error.

    The rows Q, P (n, d) at the times t are finite; ``advice`` ends the reason.
    """
    found = energy_error(system, Q, P) if system.has_energy else None
    worst = 0.0 if found is None else found.share.max()
    if not worst > NOTED:
        return Outcome(OK, "")
    if worst > LOST:
        late = found.sofar > LOST
        row = (late if late.any() else found.share > LOST).argmax()
        what = f"the energy error is of the size of H's own terms, at its largest {worst:.3g} times that"
        seen = f"from t = {t[row]:.6g} on {what}{_describe_bounded(found.size)}{describe_escape(system, Q, P, found)}"
        status = UNSTABLE if grows(found.size, found.first) else INACCURATE
        return Outcome(status, f"{seen}: what came out is not the orbit; {advice}")
    size = f"{worst:.0%} of the size of H's terms near t = {t[found.share.argmax()]:.6g}"
    return Outcome(OK, f"the energy error is {size}; {advice}")


def grows(error: np.ndarray, first: float) -> bool:
    """True if an energy error of this magnitude in each row grows; ``first`` is the size of H's terms at the start."""
    few = len(error) - 1 < PARTED
    if first > 0 and error.max() > (BLOWN_BETWEEN if few else BLOWN) * first:
        return True
    if few:
        return False
    with np.errstate(over="ignore"):
        _, second, third, last = (part.mean() for part in np.array_split(error[1:], 4))
    return bool(third > RISE * second and last > RISE * third)


def _describe_bounded(error: np.ndarray) -> str:
    first, last = np.array_split(error, 2)
    if len(last) < 10 or last.max() > 1.05 * first.max() or last.min() > 0.1 * last.max():
        return ""
    return " (it comes and goes: the step may be stable, but is far too wide)"


def describe_escape(system: PartitionedSystem, Q: np.ndarray, P: np.ndarray, found: EnergyError | None = None) -> str:
    """Text to append to a reason if the state of rows Q, P (n, d) grew large with the energy conserved, else ""."""
    if not system.has_energy or len(Q) < 2:
        return ""
    found = energy_error(system, Q, P) if found is None else found
    lost = len(Q) if found is None or found.sofar.max() < KEPT else int((found.sofar >= KEPT).argmax())
    sizes = np.maximum(np.abs(Q[:lost]).max(axis=1), np.abs(P[:lost]).max(axis=1))
    if not sizes[-1] > GROWN * sizes[0]:
        return ""
    return f"; the energy was kept until the state had grown to {sizes[-1]:.3g}: the motion itself may escape"


def energy_unit(system: PartitionedSystem, Q: np.ndarray, P: np.ndarray) -> float:
    """The energy by which errors in rows Q, P (n, d) are divided: the first row's, or H's terms' if these cancel."""
    return float(_unit(system.energies(Q[:1], P[:1]), system.scale(Q[:1], P[:1]))[0])


def _unit(H: np.ndarray, M: np.ndarray) -> np.ndarray:
    H, M = np.abs(H), np.abs(M)
    return np.where(H < KEPT * M, M, H)


# -- singularities ----------------------------------------------------------------------------------------------------


def travel(
    system: PartitionedSystem, Q: np.ndarray, P: np.ndarray, h: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(Distance to the nearest singularity, length |h dq/dt| of a step) at rows Q, P (n, d), two arrays (n,)."""
    return system.distances(Q, P).min(axis=0), np.abs(h) * system.speed(Q, P)


#: Share of the way to a singularity at which H tells whether it repels.
BESIDE = 1 - 1e-6


def _aim(system: PartitionedSystem, Q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Sine of the angle between the velocity and the direction to the nearest singularity, for each row.

    A distance that is a function of the rows, not a formula, has no gradient: its sine counts as 1 (passing by).  So
    does that of a wall, near which H grows: it turns the motion back.
    """
    rates = system.velocities(Q, P).T
    speed = np.sqrt(sum(v**2 for v in rates))
    sines = [np.ones(len(Q))]
    for k, s in enumerate(system.singular):
        if not hasattr(s, "diff"):
            continue
        slopes = [system.evaluate(f"slope {k} {i}", lambda s=s, x=x: s.diff(x), Q, P) for i, x in enumerate(system.q)]
        towards = sum(g * v for g, v in zip(slopes, rates, strict=True))
        distance = system.evaluate(f"distance {k}", lambda s=s: s, Q, P)
        with np.errstate(all="ignore"):
            square = sum(g**2 for g in slopes)
            cosine = towards / (speed * np.sqrt(square))
            beside = Q - BESIDE * (distance / square * np.array(slopes)).T
        wall = system.energies(beside, P) > system.energies(Q, P)
        sines.append(np.where(wall, 1.0, np.sqrt(np.abs(1 - cosine**2))))
    return np.min(sines, axis=0)


def describe_approach(system: PartitionedSystem, Q: np.ndarray, P: np.ndarray, h: Number) -> str | None:
    """A phrase for the user if |h dq/dt| at the last row exceeds the distance to a singularity, else None."""
    if not system.singularities or Q.dtype == object:
        return None
    distance, length = travel(system, Q[-1:], P[-1:], h)
    if length[-1] > distance[-1]:
        return f"the step {length[-1]:.3g} is longer than the distance {distance[-1]:.3g} to the singularity"
    return None


def describe_crossing(system: PartitionedSystem, t: np.ndarray, Q: np.ndarray, P: np.ndarray, h: float) -> str | None:
    """Return a sentence for the user if a step of the run jumped across a singularity of H, else None.

    There must be rows (stored states) where the length |h dq/dt| of a step exceeds the distance to the singularity.  A
    jump is reported if at one of these the motion heads straight for the singularity, or if after the first of them the
    energy error exceeds a tenth of `energy_unit`.  Q, P (n, d) are the rows at the times t.
    """
    if not system.singularities or not system.has_energy:
        return None
    distance, length = travel(system, Q, P, h)
    near = np.flatnonzero(length > distance)
    if not len(near):
        return None
    head_on = near[_aim(system, Q[near], P[near]) < HEAD_ON]
    if len(head_on):
        return f"the motion meets the singularity head-on after t = {t[head_on[0]]:.6g}; no step goes through it"
    H = system.energies(Q, P)
    if np.abs(H[near[0] :] - H[0]).max() <= NOTED * energy_unit(system, Q, P):
        return None
    return (
        f"near t = {t[near[0]]:.6g} a step of length {length[near[0]]:.3g} crosses the singularity at distance "
        f"{distance[near[0]]:.3g} and the energy is lost; take a smaller h"
    )


def flag_crossings(
    system: PartitionedSystem, Q: np.ndarray, P: np.ndarray, h: np.ndarray, H: np.ndarray, M: np.ndarray
) -> np.ndarray:
    """True for each of n orbits for which `describe_crossing` would report a step across a singularity, array (n,).

    Q, P (n, rows, d) are their rows, h (n,) their steps; H (n, rows) the energies, and M the sizes of H's terms.
    """
    n, rows, d = Q.shape
    distance, length = travel(system, Q.reshape(-1, d), P.reshape(-1, d), np.repeat(h, rows))
    near = (length > distance).reshape(n, rows)
    found = near.any(axis=1)
    if not found.any():
        return found
    with np.errstate(all="ignore"):
        since = np.where(np.maximum.accumulate(near, axis=1), np.abs(H - H[:, :1]), 0.0)
    found &= ~(since.max(axis=1) <= NOTED * _unit(H[:, 0], M[:, 0]))
    found[np.nonzero(near)[0][_aim(system, Q[near], P[near]) < HEAD_ON]] = True
    return found
