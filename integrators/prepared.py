"""Compile a method for a problem once, to integrate many times: `prepare`, then calls with h and number of steps."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from phasebench.integrators.coefficients.tableaus import LEVELS
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping import codes, energy_model, root
from phasebench.integrators.stepping.kernel import (
    COUNTED,
    COUNTS,
    Carry,
    Prepared,
    Samples,
    entry,
    kernel,
    value,
    work_of,
    zeros,
)
from phasebench.integrators.stepping.kernel import prepare as prepare_kernel
from phasebench.integrators.stepping.packed_call import packed_call

from .errors import InvalidInput
from .keywords import Parameters, State, method_parameters
from .outcome import DIVERGED, NOT_CONVERGED, OK
from .record import Method
from .registry import method as method_of
from .registry import parameter_names
from .request import initial

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number

Floats = NDArray[np.float64]
#: The statuses of the codes that a kernel returns.
STATUSES = (OK, NOT_CONVERGED, DIVERGED, NOT_CONVERGED)


@dataclass
class Layout:
    """A compiled kernel (loop over steps) with its arguments for one run; a call goes on from where the last one ended.

    The arguments are the step's coefficients, the state and memory that one call leaves for the next, and the counts.
    """

    kernel: Callable
    step: tuple
    carry: Carry
    counts: np.record

    def __call__(self, Q: np.ndarray, P: np.ndarray, parameter: np.ndarray, every: int) -> tuple[int, int]:
        """Go on from the state reached; fill Q, P (rows, d) and ``parameter`` (rows, 1), a row every ``every`` steps.

        ``parameter`` takes the parameter that the last step before each row chose to keep the energy; most methods have
        none and leave the array as it is.  Returns (number of rows filled, status code: 0 if no step failed).
        """
        return self.kernel(self.step, self.carry, Samples(Q, P, parameter, every), self.counts)

    def restart(self, q: Sequence[Any] | np.ndarray, p: Sequence[Any] | np.ndarray) -> None:
        """Prepare a new run from the state (q, p): set the counts, and what is kept of earlier steps, to zero."""
        self.carry.state.fill(0)
        self.carry.memory.fill(0)
        self.carry.state[0, : len(q)], self.carry.state[1, : len(p)] = q, p
        for name in self.counts.dtype.names:
            self.counts[name] = 0


def step_of(
    prepared: Prepared,
    d: int,
    h: Number,
    q: Sequence[Any] | np.ndarray,
    p: Sequence[Any] | np.ndarray,
    arithmetic: str = DOUBLE,
) -> NamedTuple:
    """Make the first argument of a kernel: the coefficients of a step of length h, for a run from the state (q, p).

    q and p have d components; the coefficients are numbers of the ``arithmetic``, "double" or "multiprecision".
    """
    step = prepared.step._replace(h=float(h) if arithmetic == DOUBLE else h, eps=codegen.epsilon(arithmetic))
    if prepared.begin is not None:
        step = prepared.begin(step, *(value(x, d, arithmetic, prepared.arrays) for x in (q, p)))
    return step


def lay_out(
    prepared: Prepared,
    d: int,
    h: Number,
    q: Sequence[Any] | np.ndarray,
    p: Sequence[Any] | np.ndarray,
    arithmetic: str = DOUBLE,
) -> Layout:
    """Compile a kernel (loop over steps) and allocate its memory for a run with step h from the state (q, p).

    q and p have d components.
    """
    kept = root.SLOTS * root.ROWS if prepared.searches else 0
    carry = Carry(
        state=zeros((4 + prepared.stages + kept, max(energy_model.NUMBERS, d)), arithmetic),
        memory=zeros(((3 * LEVELS + 1) * prepared.stages, prepared.width), arithmetic),
        work=work_of(prepared, arithmetic),
        zero=value(zeros(d, arithmetic), d, arithmetic, prepared.arrays),
    )
    step = step_of(prepared, d, h, q, p, arithmetic)
    layout = Layout(entry(kernel(prepared, d, arithmetic)), step, carry, np.zeros(1, COUNTS).view(np.recarray)[0])
    layout.restart(q, p)
    return layout


class PreparedRun:
    """A method on a problem, compiled: ``run(h, steps)`` integrates and stores no states on the way.

    Nothing is checked: h is a number, ``steps`` a positive integer, q0 and p0 have d finite numbers.  Every call starts
    anew.  `advance` is a call that does not copy the end state out: it is what should be timed.  Methods whose
    coefficients depend on the initial state (methods that keep its energy H0) or on h (trigonometric ones) compute the
    coefficients again if the state or h differs from the last call's, which takes longer.

    Attributes
    ----------
    method : the method
    SOLVED, STALLED, NOT_FINITE : the statuses "ok", "not-converged" and "diverged"; whether the end is on the orbit is
        not judged
    """

    SOLVED, STALLED, NOT_FINITE = OK, NOT_CONVERGED, DIVERGED

    def __init__(self, problem: Any, method: Method, q0: State | None = None, p0: State | None = None) -> None:
        system, q, p = initial(problem, q0, p0, tangent=method.tangent)
        lack = method.lacks(system)
        if lack:
            raise InvalidInput(lack)
        self.method, self._system, self._d = method, system, system.d
        self._default, self._start, self._end = np.array([q, p]), np.array([q, p]), np.zeros((2, 1, system.d))
        self._prepared = prepare_kernel(method, system)
        self._begun = None  # the start and h that the step was made for
        self._moved = False
        self._layout = lay_out(self._prepared, system.d, 1.0, q, p)
        self._parameter = np.full((1, 1), np.nan)
        self._call = self._run_uncompiled
        if codegen.compiled():
            functions = packed_call(self._prepared, system.d)
            self._memory = np.zeros(functions.size, np.uint8)
            self._address = self._memory.ctypes.data
            self._functions, self._call = functions, functions.call
            self._pack()

    def __repr__(self) -> str:
        return f"PreparedRun({self.method.label} on {self._system!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies are built anew: the memory that holds the kernel's arguments has one owner, who releases it."""
        return PreparedRun, (self._system, self.method, *self._default), (self._start, self._moved)

    def __setstate__(self, state: tuple[Floats, bool]) -> None:
        """Start a copy from the state from which the original starts."""
        self._start[:], self._moved = state

    def __call__(
        self, h: float, steps: int, q0: State | None = None, p0: State | None = None
    ) -> tuple[Floats, Floats, str]:
        """(q, p, status) after ``steps`` steps; NaN where a stage equation was not solved.

        Parameters
        ----------
        h : step, in the problem's unit of time
        steps : how many, at least 1
        q0, p0 : arrays (d,), the initial state if not the problem's
        """
        if q0 is not None or p0 is not None:
            self.restart(self._default[0] if q0 is None else q0, self._default[1] if p0 is None else p0)
            self._moved = True
        elif self._moved:
            self.restart(*self._default)
            self._moved = False
        code = self.advance(h, steps)
        end = self._end.copy()
        return end[0, 0], end[1, 0], STATUSES[code]

    def restart(self, q0: State, p0: State) -> None:
        """Set the state, arrays (d,), from which `advance` starts."""
        self._start[0], self._start[1] = q0, p0

    def advance(self, h: float, steps: int) -> int:
        """Integrate from the state that `restart` set, at first the initial one; return the kernel's code, 0 for "ok".

        The end state stays in the kernel's memory.
        """
        if self._prepared.begin is not None:
            self._begin(h)
        return self._call(self._address, h, steps)

    @property
    def counts(self) -> dict[str, int]:
        """Counts of the last call: name -> number of steps, gradient evaluations, Newton solves and fallbacks.

        A fallback is a step without the property that the method promises.
        """
        return {name: int(self._layout.counts[name]) for name in COUNTED}

    @property
    def values(self) -> str:
        """How the kernel represents states: "tuple" (of numbers in registers) or "array"."""
        return codegen.value_kind(self._d, self._prepared.arrays)

    def _begin(self, h: float) -> None:
        """Recompute the step's coefficients if h or the initial state differ from the last call's."""
        wanted = (h, self._start.tobytes())
        if wanted != self._begun:
            self._layout.step = step_of(self._prepared, self._d, h, *self._start)
            self._begun = wanted
            if codegen.compiled():
                self._pack()

    _address, _packed = 0, False

    def _pack(self) -> None:
        """Write the kernel's arguments into memory, for calls by address."""
        self._release()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
            self._write()
        self._packed = True

    def _write(self) -> None:
        it = self._layout
        samples = Samples(*self._end, self._parameter, 1)
        self._functions.pack(self._address, self._functions.run, it.step, it.carry, samples, it.counts, self._start)

    def _release(self) -> None:
        if self._packed:
            self._functions.release(self._address)
            self._packed = False

    __del__ = _release

    def _run_uncompiled(self, address: int, h: float, steps: int) -> int:
        """Integrate ``steps`` steps of h from the start by the uncompiled kernel; returns the status code.

        ``address`` is not used: the function replaces a compiled one that has this argument.
        """
        self._layout.step = self._layout.step._replace(h=float(h))
        self._layout.restart(*self._start)
        self._end.fill(np.nan)
        code = self._layout(*self._end, self._parameter, steps)[1]
        return code if code or np.isfinite(self._end).all() else codes.NOT_FINITE


@method_parameters(parameter_names)
def prepare(
    problem: Any,
    method: str | Method,
    *,
    q0: State | None = None,
    p0: State | None = None,
    parameters: Parameters | None = None,
) -> PreparedRun:
    """Compile ``method`` for ``problem``, for many short integrations and for timing.

    Parameters
    ----------
    problem : a problem: a system with initial data; or a system, where q0 and p0 are given
    method : an id or a method
    q0, p0 : arrays (d,), the initial state if not the problem's
    parameters : values of the method's parameters

    Returns
    -------
    PreparedRun
        Called with h and the number of steps it returns (q, p, status).

    Raises
    ------
    InvalidInput
        For an unknown method or parameter, a problem without initial data, or a system that the method cannot do.

    Examples
    --------
    >>> from phasebench.benchmarks.problems import problem
    >>> run = prepare(problem("pendulum"), "stormer-verlet")
    >>> run(0.01, 100)[2]
    'ok'
    """
    return PreparedRun(problem, method_of(method, **(parameters or {})), q0, p0)
