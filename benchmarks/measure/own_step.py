"""A user's own step: a Python function, or a file with one, integrated like a method.

A file is plain Python::

    def step(system, q, p, h):
        p = p - h * system.dH_dq(q, p)
        q = q + h * system.dH_dp(q, p)
        return q, p

    CLAIMS = {"order": 1, "symplectic": True}
    REQUIRES = ("separable",)

q and p are read-only arrays (d,); the step returns new ones.  CLAIMS and REQUIRES (traits that the system must have)
are optional.  A step that is called with the time is ``step(system, q, p, h, t)``, see `timed_step`.  With
``REQUIRES = ("magnetic",)`` it may be ``step(system, x, v, h)``, see `particle_step`.  With
``REQUIRES = ("constrained",)`` it is a step on the manifold of constraints g(q) = 0: it has ``system.g(q)`` (m,) and
``system.G(q)`` = g_q (m, d), and ``dH_dq``, ``dH_dp`` are those of H without them.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasebench.benchmarks.judge.checks import checked_claims
from phasebench.benchmarks.problems import user_file
from phasebench.integrators import record
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.driver import OK, TIMEOUT, Solution
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.request import check_timeout, request
from phasebench.integrators.systems.magnetic import CLASSICAL
from phasebench.reference.peers.run import ending

from . import particle_step, timed_step

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.keywords import State
    from phasebench.integrators.request import Request
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

Floats = NDArray[np.float64]
#: The last arguments of a step, in turn.
STATE = ("q", "p", "h")


@dataclass(frozen=True)
class OwnStep:
    """A user's own one-step method, given as a Python function, with what the user claims of it.

    Attributes
    ----------
    id, step : the function's name, or the path of its file; (system, q, p, h) -> (q, p), see `System`
    claims, requires : name -> value of claimed properties (`judge.checks.CHECKS`); traits that the system must have
    where : the file of its code, as in a traceback
    again : path -> the step, which reads its file once more when the step is unpickled; None if it is from no file
    changed : the same step with the last digits of its coefficients changed, where it is made from a table
    exchanged : (how a table says so, its step if it begins with the other substep), of a splitting that can
    """

    id: str
    step: Callable[..., tuple[Any, Any]]
    claims: Mapping[str, Any] = field(default_factory=dict, hash=False)
    requires: tuple[str, ...] = ()
    where: str = ""
    again: Callable[[str], OwnStep] | None = None
    changed: Callable | None = None
    exchanged: tuple[str, Callable] | None = None

    #: For the same interface as a method; a step has no parameters, and starts from a state on all constraints.
    parameters = {}  # noqa: RUF012
    tangent = one_step = True

    def __post_init__(self) -> None:
        if particle_step.TRAIT in self.requires and particle_step.in_velocities(self.step):
            object.__setattr__(self, "step", particle_step.InMomenta(self.step))
        elif timed_step.in_time(self.step) and not isinstance(self.step, timed_step.InTime):
            object.__setattr__(self, "step", timed_step.InTime(self.step, check_pair))

    @property
    def label(self) -> str:
        """The step's label, which is its id."""
        return self.id

    @property
    def order(self) -> int | None:
        """The claimed order, or None."""
        return self.claims.get("order")

    def lacks(self, system: PartitionedSystem) -> str | None:
        """Return why the step cannot run on ``system``, or None; InvalidInput for a trait that does not exist."""
        for trait in self.requires:
            if trait not in system.traits:
                raise unknown_name("trait of systems", trait, system.traits)
        kind = system.traits[particle_step.TRAIT]
        if kind and kind != CLASSICAL and isinstance(self.step, particle_step.InMomenta):
            return f"a step of (x, v) is of a particle that is not relativistic, and this one is {kind}"
        kinds = () if CONSTRAINED in self.requires else ("canonical",)
        return record.lacks(self.id, (*kinds, *self.requires), system)

    def __reduce__(self) -> tuple[Callable[..., OwnStep], tuple[Any, ...]]:
        """Pickle a step from a file by its path, so that the receiving process reads the file again."""
        if self.again is not None:
            return self.again, (self.id,)
        return OwnStep, (self.id, self.step, self.claims, self.requires, self.where)


#: The trait that a step on constraints requires.
CONSTRAINED = "constrained"
NO_CONSTRAINTS = (
    "the system has no constraints g: those of a ConstrainedHamiltonian are given to a step with "
    "REQUIRES = ('constrained',)"
)
NO_FIELDS = (
    "the fields E and B are those of a charged particle: "
    "write step(system, x, v, h), its arguments so named, and REQUIRES = ('magnetic',)"
)


class System:
    """The argument ``system`` of a user's step function: H and its derivatives at q and p, arrays (d,).

    Attributes
    ----------
    d : degrees of freedom
    evaluations : [number of evaluations of `dH_dq`, number of evaluations of `dH_dp`]
    whole : the underlying system
    """

    def __init__(self, system: Any) -> None:
        self.d: int
        self.d, self.evaluations, self.whole = system.d, [0, 0], system
        free = system.free if system.constrained else system
        self._system, self._field = system, free.vector_field()

    @cached_property
    def particle(self) -> particle_step.Particle:
        """The system as a charged particle with fields E and B, for a step written in positions and velocities."""
        return particle_step.Particle(self.whole, DOUBLE, self.evaluations)

    @property
    def E(self) -> NoReturn:
        """Raise AttributeError with a hint: only a step(system, x, v, h) is given the fields of a charged particle."""
        raise AttributeError(NO_FIELDS)

    B = E

    def _state(self, q: ArrayLike, p: ArrayLike) -> Floats:
        return np.concatenate([_vector(x, f"the system is called with {n}", self.d) for n, x in (("q", q), ("p", p))])

    def dH_dq(self, q: ArrayLike, p: ArrayLike) -> Floats:
        """The gradient of H by q, array (d,)."""
        self.evaluations[0] += 1
        return -self._field(0.0, self._state(q, p))[self.d :]

    def dH_dp(self, q: ArrayLike, p: ArrayLike) -> Floats:
        """The gradient of H by p, array (d,)."""
        self.evaluations[1] += 1
        return self._field(0.0, self._state(q, p))[: self.d]

    def g(self, q: ArrayLike) -> Floats:
        """The constraints g(q), array (m,); raises AttributeError, with a hint, if the system has none."""
        return self._constraints(q)[0]

    def G(self, q: ArrayLike) -> Floats:
        """The Jacobian g_q of the constraints, array (m, d); raises AttributeError, with a hint, if there are none."""
        return self._constraints(q)[1]

    def _constraints(self, q: ArrayLike) -> tuple[Floats, Floats]:
        if not self._system.constrained:
            raise AttributeError(NO_CONSTRAINTS)
        return self._system.constraint_values(_vector(q, "the constraints are called with q", self.d))

    def H(self, q: ArrayLike, p: ArrayLike) -> float:
        """The energy at q, p."""
        state = self._state(q, p)
        return float(self._system.observe(self._system.H, state[None, : self.d], state[None, self.d :])[0])


#: What a user's own step is: (system, q, p, h) -> (q, p).
Step = Callable[[System, Floats, Floats, float], tuple[ArrayLike, ArrayLike]]


def from_function(step: Callable) -> OwnStep:
    """Make an `OwnStep` of a function (system, q, p, h) -> (q, p), or (system, q, p, h, t) -> (q, p).

    Raises InvalidInput if it takes other arguments.
    """
    code = getattr(step, "__code__", None) or getattr(type(step).__call__, "__code__", None)
    where = code.co_filename if code else "the step"
    try:
        inspect.signature(step).bind("system", "q", "p", "h", *(["t"] if timed_step.in_time(step) else []))
    except TypeError as error:
        raise InvalidInput(f"{where}: a step is called as step(system, q, p, h), or with a fifth t: {error}") from None
    except ValueError:  # the function's signature is not available
        return OwnStep(getattr(step, "__name__", type(step).__name__), step, where=where)
    names = list(inspect.signature(step).parameters)[:4]
    if any(name in STATE and place != 1 + STATE.index(name) for place, name in enumerate(names)):
        raise InvalidInput(f"{where}: a step is called (system, q, p, h), and this one takes ({', '.join(names)})")
    return OwnStep(getattr(step, "__name__", type(step).__name__), step, where=where)


def from_file(path: str | Path) -> OwnStep:
    """Make an `OwnStep` of a Python file (``./mine.py``, ``./mine.py:object.step``) with its CLAIMS and REQUIRES.

    Raises InvalidInput for a file that cannot be read or raises (with the line), or that has no such step.
    """
    path = str(path)
    owner, step = find_step(path, "step")
    from_function(step)  # its arguments
    return replace(build_own_step(path, owner, step), again=from_file)


def find_step(path: str, name: str) -> tuple[Any, Callable]:
    """Load a user's Python file and return (owner, function), the function of a step and what declares its claims.

    The function is that of ``./mine.py:object.function``, or ``name`` in ``./mine.py``.  The owner is the object if it
    has CLAIMS or REQUIRES, else the module.  Raises InvalidInput as `from_file`.
    """
    file, dotted = user_file.file_and_object(path)
    module = user_file.load(file, "method")
    owner = found = module
    for part in (dotted or name).split("."):
        holder, found = found, getattr(found, part, None)
        if found is None:
            has = f"has no function '{part}'" if holder is module else f"has no '{part}' in '{dotted}'"
            raise InvalidInput(f"{file} {has}; write def {name}(system, q, p, h): ... return q, p")
        if holder is not module and any(hasattr(holder, says) for says in ("CLAIMS", "REQUIRES")):
            owner = holder
    if not callable(found):
        what = f"'{dotted or name}' that is a {type(found).__name__}"
        raise InvalidInput(f"{file} has a {what}; write def {name}(system, q, p, h): ... return q, p")
    return owner, found


def build_own_step(path: str, module: object, function: Callable) -> OwnStep:
    """Make an `OwnStep` of a function, with id ``path`` and the CLAIMS and REQUIRES of a module or an object."""
    requires = checked_requires(getattr(module, "REQUIRES", ()), f"{path}: REQUIRES")
    code = getattr(function, "__code__", None)
    claims = checked_claims(getattr(module, "CLAIMS", {}), f"{path}: CLAIMS")
    return OwnStep(path, function, claims, requires, code.co_filename if code else "the step")


def checked_requires(requires: object, where: str) -> tuple[str, ...]:
    """Return the traits that a step requires, one text or several, as a tuple; else InvalidInput, from ``where`` on."""
    several = (requires,) if isinstance(requires, str) else requires
    if not isinstance(several, (tuple, list)) or not all(isinstance(x, str) for x in several):
        raise InvalidInput(f"{where} is {requires!r}; name traits, such as ['separable']")
    return tuple(several)


def integrate_step(
    problem: Problem | PartitionedSystem,
    own: OwnStep,
    *,
    h: float | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    t0: float = 0.0,
    q0: State | None = None,
    p0: State | None = None,
    save_every: int = 1,
    timeout: float | None = None,
) -> Solution:
    """Integrate ``problem`` with a user's own step at constant h; arguments as in `integrators.driver.integrate`.

    No step is taken ``timeout`` seconds after the start; one that does not return cannot be stopped.  ``seconds`` of
    the solution is the time of the Python loop, its gradient in ``counts`` the larger number of evaluations of dH_dq
    and dH_dp. Raises InvalidInput for unusable input, and for a step that raises (with file and line), that returns
    anything but two arrays (d,) of real numbers, or that changes its q or p.
    """
    check_timeout(timeout)
    asked = request(problem, h=h, t_end=t_end, steps=steps, q0=q0, p0=p0, save_every=save_every, t0=t0)
    lack = own.lacks(asked.system)
    if lack:
        raise InvalidInput(lack)
    seen = System(asked.system)
    seen.dH_dq(asked.q, asked.p)  # compile the vector field before the clock starts
    seen.evaluations[:] = 0, 0
    numbers = asked.step_numbers
    rows = np.empty((2, len(numbers), seen.d))
    rows[:, 0] = asked.q, asked.p
    started = time.perf_counter()
    with user_file.users_code(own.where, "its step"), np.errstate(all="ignore"):
        row, taken, late = _steps(own.step, seen, asked, rows, None if timeout is None else started + timeout)
    seconds = time.perf_counter() - started
    if late:
        numbers = [*numbers[: row - 1], taken]
    times = asked.t0 + asked.h * np.array(numbers, float)
    status, reason, kept = ending(asked.system, times, *rows[:, :row], None)
    if status == OK and late:
        status = TIMEOUT
        reason = f"{timeout} s had passed after step {taken} of {asked.steps}; what was reached is kept"
    counts = {"steps": taken, "gradient": max(seen.evaluations), "hessian": 0, "iterations": 0, "fallbacks": 0}
    q, p = rows[:, :kept].copy()
    unknown = np.full(kept - 1, np.nan)
    return Solution(times[:kept], q, p, status, reason, counts, asked.h, own, unknown, seconds, problem)


def _steps(
    step: Callable[..., tuple[Any, Any]], seen: System, asked: Request, rows: np.ndarray, deadline: float | None
) -> tuple[int, int, bool]:
    """Take the steps of a run into rows (2, n, d): (rows filled, steps taken, True if time ran out); ends at a NaN."""
    q, p, row, timed = asked.q, asked.p, 1, isinstance(step, timed_step.InTime)
    for n in range(1, asked.steps + 1):
        now = (asked.t0 + (n - 1) * asked.h,) if timed else ()
        try:
            q, p = check_pair(step(seen, _frozen(q), _frozen(p), asked.h, *now), seen.d)
        except ValueError as error:
            if "read-only" not in str(error):
                raise
            why = InvalidInput("a step must not change its q and p: write q = q + ..., not q += ...")
            raise why.with_traceback(error.__traceback__) from error
        if n == asked.steps or n % asked.every == 0:
            rows[:, row] = q, p
            row += 1
        if not (np.isfinite(q).all() and np.isfinite(p).all()):
            return row, n - 1, False
        if deadline is not None and n < asked.steps and time.perf_counter() > deadline:
            if n % asked.every:  # the last state is not yet in a row
                rows[:, row] = q, p
                row += 1
            return row, n, True
    return row, asked.steps, False


def _frozen(x: np.ndarray) -> np.ndarray:
    """Make an array read-only, and return a view of it that cannot be made writable."""
    x.flags.writeable = False
    return x.view()


def check_pair(pair: Any, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Copy what a user's step returned to new arrays q, p (d,); raise InvalidInput unless it is two such arrays."""
    if not particle_step.is_pair(pair):
        raise InvalidInput(f"step returned {_short_text(pair)}; it must return q, p")
    return _vector(pair[0], "step returned q", d), _vector(pair[1], "step returned p", d)


def _vector(x: Any, what: str, d: int) -> np.ndarray:
    try:
        if np.iscomplexobj(x):
            raise TypeError
        vector = np.array(x, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{what} = {_short_text(x)}; it must be an array of real numbers") from None
    if vector.shape != (d,):
        raise InvalidInput(f"{what} of shape {vector.shape}; it must be ({d},)")
    return vector


def _short_text(x: object) -> str:
    text = repr(x)
    return text if len(text) <= 60 else f"{type(x).__name__} {text[:60]} ..."
