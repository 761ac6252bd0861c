r"""galpy's integrators as peers, through `galpy.orbit.Orbit.integrate`.

A system :math:`H = |p|^2/2 + V(q)` with d = 1, 2 or 3 is an orbit on a line, in the plane or in space:

- the methods in C (``..._c``) work for galpy's own potentials: sums of powers of the distance, which are its
  PowerSphericalPotential (on a line its KGPotential if V is quadratic, else the plane), and Henon-Heiles.  For other
  potentials galpy warns and runs LSODA or its Python leapfrog instead; such problems are refused;
- the methods in Python take a potential defined in Python, hence any V.

Orbits are passed in polar or cylindrical coordinates, which costs a rounding of about 1e-16 each way.  In the plane and
in space galpy computes the angle of the force as acos(x/R), which has an error of up to 1e-8 within 1e-8 of the x axis
and loses digits near it; this affects forces that depend on the angle, such as Henon and Heiles's.  The Python leapfrog
computes the angle of its rows in this way too.

Fixed steps: ``dt`` is the step h of a method in C.  The number of steps between two rows is their distance divided by
dt, which galpy truncates (0.3 / 0.1 gives 2, so that states belong to other times; a script of the audit shows it);
therefore the distance of rows is enlarged by a rounding if necessary.  The Python leapfrog chooses its step by a
tolerance, which is set so large here that the step is the distance of its rows, h.

Three defects are handled here.  Adaptive integrators do not return from a blow-up, a collision or a start at the origin
(ias15_c returns uninitialized rows), so heyoka tests the orbit first.  The C code leaves SIGINT with the system's
handler, so the one before is put back.  The import looks for a newer version on the network, which `load` prevents.

Source: J. Bovy, Astrophys. J. Suppl. Ser. 216 (2015) 29.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from math import gcd
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries

from . import interrupts
from .forms import is_henon_heiles, powers, unit_mass
from .record import Claims, Peer, Run, Task

if TYPE_CHECKING:
    from types import ModuleType

    from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

METHODS_IN_WORDS = "Orbit.integrate.__doc__ of galpy 1.12.1"
#: A tolerance so large that the Python leapfrog never shortens its step.
ANY_STEP = 1e10
#: Largest loss of energy in heyoka's test run that does not indicate a collision.
LOST = 1e-6
#: Least number of rows for two methods: odeint stops at 500 steps per row, ias15_c overshoots the end by up to a row.
ROWS = 256


def load(name: str = "galpy") -> ModuleType:
    """Import galpy without its daily search for a newer version, which contacts a server and runs pip."""
    from unittest.mock import patch  # slow to import

    with patch("http.client.HTTPSConnection.request", side_effect=OSError):
        import galpy.orbit
        import galpy.potential
    return galpy


# -- potentials ---------------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def _builtin_potential(system: Hamiltonian) -> Any:
    """The system's potential as one of galpy's own, which its C code supports."""
    galpy = load().potential
    if is_henon_heiles(system):
        return galpy.HenonHeilesPotential()
    terms = powers(system)
    if _on_line(system, True):
        return galpy.KGPotential(K=0.0, F=terms[0][0], D=1.0)
    # V = c r^a has the force -c a r^(a - 1), hence the density amp r^-alpha (a point mass c if a = -1)
    parts = [
        galpy.PowerSphericalPotential(amp=c * a if a == -1 else c * a * (1.0 + a) / (4.0 * np.pi), alpha=2.0 - a)
        for c, a in terms
    ]
    total = sum(parts[1:], parts[0])
    return total if system.d == 3 else galpy.toPlanarPotential(total)


@lru_cache(maxsize=64)
def _python_potential(system: Hamiltonian) -> Any:
    """The system's potential as a galpy class defined in Python."""
    galpy, d, field = load().potential, system.d, system.vector_field()
    last: dict = {}

    def force(*q: float) -> np.ndarray:
        if last.get("q") != q:
            last["q"], last["force"] = q, field(0.0, np.array([*q, *q]))[d:]
        return last["force"]

    def polar(k: int) -> Callable[..., float]:
        def component(potential: Any, R: float, *z: float, phi: float = 0.0, t: float = 0.0) -> float:
            c, s = np.cos(phi), np.sin(phi)
            f = force(R * c, R * s, *z)
            return (c * f[0] + s * f[1], R * (c * f[1] - s * f[0]), f[-1])[k]

        return component

    names, base = {"_Rforce": polar(0), "_phitorque": polar(1)}, galpy.planarPotential
    if d == 1:
        names, base = {"_force": lambda potential, x, t=0.0: force(np.ravel(x)[0])[0]}, galpy.linearPotential
    elif d == 3:
        names, base = names | {"_zforce": polar(2)}, galpy.Potential
    made = type("Formula", (base,), names)(amp=1.0)
    made.isNonAxi = d > 1
    return made


def _on_line(system: Hamiltonian, own: bool) -> bool:
    """True if galpy's orbit is one on a line; its ``own`` potentials are in the plane at d = 1, unless V = c q^2."""
    return system.d == 1 and (not own or [a for _, a in powers(system) or ()] == [2])


# -- coordinates --------------------------------------------------------------------------------------------------


def _to_galpy(q: Sequence[float] | np.ndarray, p: Sequence[float] | np.ndarray, line: bool) -> list[float]:
    """The initial state in galpy's coordinates: (x, v) on a line, else (R, vR, vT, phi) or (R, vR, vT, z, vz, phi)."""
    if line:
        return [q[0], p[0]]
    x, y, vx, vy = q[0], q[1] if len(q) > 1 else 0.0, p[0], p[1] if len(p) > 1 else 0.0
    phi = np.arctan2(y, x)
    c, s = np.cos(phi), np.sin(phi)
    height = [q[2], p[2]] if len(q) > 2 else []
    return [float(v) for v in (np.hypot(x, y), vx * c + vy * s, vy * c - vx * s, *height, phi)]


def _from_galpy(rows: np.ndarray, d: int, line: bool) -> tuple[np.ndarray, np.ndarray]:
    """q and p, arrays (n, d), of galpy's rows (R, vR, vT, phi), (R, vR, vT, z, vz, phi), or (x, vx) on a ``line``."""
    if line:
        return rows[:, :1], rows[:, 1:2]
    R, vR, vT, phi = rows[:, 0], rows[:, 1], rows[:, 2], rows[:, -1]
    c, s = np.cos(phi), np.sin(phi)
    q, p = [R * c, R * s], [vR * c - vT * s, vR * s + vT * c]
    if d == 3:
        q, p = [*q, rows[:, 3]], [*p, rows[:, 4]]
    return np.array(q[:d]).T, np.array(p[:d]).T


# -- runs ---------------------------------------------------------------------------------------------------------


def _times(method: str, adaptive: bool, task: Task) -> tuple[np.ndarray, float, dict[str, Any]]:
    """Choose the times at which galpy is to return rows for a task: (times, steps from row to row, options).

    The number of steps of h from row to row may be a fraction, since two adaptive methods need at least `ROWS` rows.
    Options are keyword arguments of galpy: its step ``dt``, or its tolerances ``rtol`` and ``atol``.
    """
    h, stride = task.h, gcd(*np.diff(task.numbers).tolist())
    count = task.steps // stride
    if method == "leapfrog":
        return h * np.arange(task.steps + 1), 1, {"rtol": ANY_STEP, "atol": ANY_STEP}
    if not adaptive:
        apart = h * stride
        while int(apart / h) < stride:
            apart = np.nextafter(apart, np.inf)
        return apart * np.arange(count + 1), stride, {"dt": h}
    parts = -(-ROWS // count) if method in ("odeint", "ias15_c") else 1
    return h * stride * np.arange(count * parts + 1) / parts, stride / parts, task.tolerances("rtol", "atol")


def _integrate(
    method: str, potential: Any, start: list[float], times: np.ndarray, options: dict[str, Any]
) -> tuple[np.ndarray | None, float, str | None]:
    """Integrate by galpy from ``start``, in its coordinates: (rows at the times or None, seconds, failure or None)."""
    from scipy.integrate import ODEintWarning

    orbit = load().orbit.Orbit(start)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        # Instead of failing, galpy would continue with another method, and SciPy's odeint would return invalid rows.
        warnings.filterwarnings("error", message="Cannot use")
        warnings.filterwarnings("error", category=ODEintWarning)
        handler, began = interrupts.handler(), time.perf_counter()
        try:
            orbit.integrate(times, potential, method=method, progressbar=False, **options)
        except (Warning, ArithmeticError, ValueError) as error:
            return None, time.perf_counter() - began, str(error)
        finally:
            interrupts.put_back(handler)
        return np.asarray(orbit.getOrbit()), time.perf_counter() - began, None


@lru_cache(maxsize=256)
def _hopeless(system: Hamiltonian, q: tuple, p: tuple, end: float) -> str | None:
    """The reason why galpy's adaptive integrators would not return from this orbit, found by heyoka; else None."""
    from phasebench.reference.solvers import taylor

    ta = taylor.integrator(system, float)
    taylor.start(ta, float, q, p)
    rows, _, failure = taylor.propagate(ta, np.array([0.0, end]))
    if failure is None and np.isfinite(rows).all():
        H = system.observe(system.H, rows[:, : system.d], rows[:, system.d :])
        if abs(H[1] - H[0]) < LOST * (1.0 + abs(H[0])):
            return None
    return "heyoka does not reach the end either: a blow-up or a collision, from which galpy would not return"


@lru_cache(maxsize=256)
def _warm(method: str, system: Hamiltonian, own: bool) -> Any:
    """A system's potential for galpy, its ``own`` or in Python, after a step in it, so that no set-up is timed."""
    potential = _builtin_potential(system) if own else _python_potential(system)
    start = _to_galpy([0.5, 0.25, 0.125][: system.d], [0.0] * system.d, _on_line(system, own))
    _integrate(method, potential, start, np.array([0.0, 1e-3]), {})
    return potential


def _build_run(method: str, adaptive: bool) -> Callable[[Task], Run]:
    own = method.endswith("_c")

    def run(task: Task) -> Run:
        system, line = task.system, _on_line(task.system, own)
        start = _to_galpy(task.q, task.p, line)
        potential = _warm(method, system, own)
        times, every, options = _times(method, adaptive, task)
        rows, seconds, failure = None, 0.0, None
        if not line and start[0] == 0:
            failure = "the orbit starts on the axis of polar coordinates, where galpy's forces are 0/0"
        elif adaptive:
            failure = _hopeless(system, tuple(map(float, task.q)), tuple(map(float, task.p)), float(task.times[-1]))
        if failure is None:
            rows, seconds, failure = _integrate(method, potential, start, times, options)
        steps = 0 if adaptive else task.steps
        if failure is not None:
            return Run.stuck(task, steps, 0, seconds, failure)
        Q, P = _from_galpy(rows[[round(n / every) for n in task.numbers]], system.d, line)
        Q[0], P[0] = task.q, task.p
        return Run(Q, P, steps, 0, seconds)

    return run


def _lacks(method: str) -> Callable[[Any, PartitionedSystem], str | None]:
    def lacks(problem: Any, system: PartitionedSystem) -> str | None:
        if not unit_mass(system):
            return "galpy integrates H = |p|^2 / 2 + V(q) alone: bodies in a potential"
        if system.d > 3:
            return f"galpy's orbits are of one body in a potential: d is 1, 2 or 3, not {system.d}"
        if not method.endswith("_c"):
            return None
        if not is_henon_heiles(system) and not powers(system):
            return (
                f"{method} takes potentials that galpy has in C: here sums of powers of the distance, even ones on a "
                "line, and Henon-Heiles; on others galpy runs another method instead"
            )
        return None

    return lacks


IN_C = "V a sum of powers of the distance, or Henon-Heiles (what galpy has in C)"
IN_PYTHON = "H = |p|^2 / 2 + V(q), d at most 3"


def _peer(
    method: str, about: str, adaptive: bool = False, claims: Mapping[str, Any] | None = None, **facts: Any
) -> Peer:
    own = method.endswith("_c")
    cost = "compiled C" if own else "forces in Python"
    return Peer(
        f"galpy-{method.replace('_', '-')}",
        package="galpy",
        adaptive=adaptive,
        license="BSD-3-Clause",
        about=f"{about}; {cost}; the time includes the set-up of a call and rows in polar coordinates",
        run=_build_run(method, adaptive),
        scope=IN_C if own else IN_PYTHON,
        lacks=_lacks(method),
        claims=Claims(**({"source": METHODS_IN_WORDS} | (claims or {}))),
        load=load,
        **facts,
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
