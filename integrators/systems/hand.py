r"""Hamiltonians whose functions are loops written by hand: lattices, wave equations on a grid, many bodies.

The functions that every step calls are not derived from a formula: at hundreds of variables its text is long and slow
to compile.  A loop compiles fast, and serves 10,000 variables as it does 30.

The contract of the loops:

1. Each loop is made by a function of the constants: ``loops={"grad_V": grad_V}`` with ``def grad_V(a, b): def f(q):
   ...; return f``.  The constants come as doubles, or as multiprecision numbers; a loop holds no rounded number itself.
2. ``energy``: (q, p) -> (H, M).  The round-off of H is about M times the machine epsilon: M is the sum of the absolute
   values of H's terms and of every \|x_i H_{x_i}\|.
3. ``field``: (q, p, h, lam) -> (H_p, -H_q); h and lam are not used.
   Or, faster, (q, p, h, lam, dq, dp): the loop writes H_p and -H_q into the arrays dq and dp.
4. ``grad_V``: q -> grad V(q), or (q, g): the loop writes the gradient into the array g.  It is given if
   H = \|p\|^2 / 2 + V(q): the system then is separable with unit masses.  With ``frequencies``, ``grad_U`` is given
   too: the gradient of V without the linear springs.
5. q and p are arrays (d,) of doubles when Numba compiles the loop, object arrays in multiprecision: use plain loops
   over components, sums and products; ``x**0.5`` is a root.  Return new arrays, and leave the arguments as they are.
   Arrays to write into hold arbitrary values at first, and are never q or p; a loop that writes into them allocates no
   others.
6. A function that loops call is decorated by `part`, never inlined by Numba (``inline="always"``): closures that take
   slices of their arguments gave wrong values when they were inlined, without a warning.
7. The formula H may be left out.  Then all that derives from it (integrators of other packages, methods that need
   second derivatives) raises InvalidInput.

Test the loops against the formula at a small size: ``tests/integrators/test_hand.py`` shows how, and a lattice of
10,000 sites beside it.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numba import types
from numba.extending import register_jitable

from phasebench.integrators.compile import codegen, machine
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.values import inplace, vector

from .hamiltonian import Hamiltonian, _symbols

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.integrators.values.kinds import Function, Number

    from .hamiltonian import Floats, Formula, Names


def part(loop: Callable) -> Callable:
    """Make a hand-written loop callable from other loops when Numba compiles them; use it as a decorator."""
    return register_jitable(**vector.COMMON)(loop)


def unit_mass_field(force: Callable) -> Callable:
    """Make the loop (q, p, h, lam, dq, dp) that writes the vector field (p, -grad V) into dq and dp.

    ``force`` is a loop (q, out) that writes -grad V(q) into the array ``out``; h and lam are ignored.
    """
    force = part(force)

    def f(q: np.ndarray, p: np.ndarray, h: Number, lam: Number, dq: np.ndarray, dp: np.ndarray) -> None:
        for i in range(len(p)):
            dq[i] = p[i]
        force(q, dp)

    return f


@lru_cache(maxsize=256)
def _compile(name: str, loop: Callable, constants: tuple[float, ...], fills: bool, d: int) -> Function:
    """Compile a user's loop for these constants; with ``fills`` it writes its results into arrays."""
    source = Path(inspect.getfile(loop)).read_bytes()  # of helpers too
    content = f"{loop.__qualname__}|{constants}|{hashlib.sha256(source).hexdigest()}"
    signature = SIGNATURES[name](codegen.value_type(d))
    made, writes = _adapt(loop(*constants), len(signature.args), fills)
    options = vector.TUPLES if fills and writes else vector.ARRAYS  # a loop that writes need not allocate
    return machine.load_or_compile(
        made, inplace.signature(signature) if fills else signature, options, f"loop {fills}|{content}"
    )


#: Name of a loop -> a function that maps the Numba type of q to the signature of the loop that returns its results.
SIGNATURES = {
    "energy": lambda T: types.UniTuple(types.float64, 2)(T, T),
    "field": lambda T: types.Tuple((T, T))(T, T, types.float64, types.float64),
    "grad_V": lambda T: T(T),
    "grad_U": lambda T: T(T),
}


def _adapt(loop: Callable, given: int, fills: bool) -> tuple[Callable, bool]:
    """Let a user's loop write its results into arrays if ``fills``, else return them: (the loop, True if it writes).

    A loop writes if it has more arguments than are ``given``.
    """
    writes = len(inspect.signature(loop).parameters) > given
    if writes == fills:
        return loop, writes
    loop = part(loop)

    def returning_gradient(q: np.ndarray) -> np.ndarray:
        g = np.empty_like(q)
        loop(q, g)
        return g

    def returning_field(q: np.ndarray, p: np.ndarray, h: Number, lam: Number) -> tuple[np.ndarray, np.ndarray]:
        dq, dp = np.empty_like(q), np.empty_like(p)
        loop(q, p, h, lam, dq, dp)
        return dq, dp

    def writing_gradient(q: np.ndarray, g: np.ndarray) -> None:
        g[:] = loop(q)

    def writing_field(q: np.ndarray, p: np.ndarray, h: Number, lam: Number, dq: np.ndarray, dp: np.ndarray) -> None:
        dq[:], dp[:] = loop(q, p, h, lam)

    if given == 1:
        return (writing_gradient if fills else returning_gradient), writes
    return (writing_field if fills else returning_field), writes


def uncompiled_loop(name: str, loop: Callable, constants: Iterable[Number]) -> Callable:
    """Return the user's loop for these constants, uncompiled, as a function that returns its results.

    ``loop`` makes the loop from the constants; ``name`` is "energy", "field", "grad_V" or "grad_U".
    """
    return _adapt(loop(*constants), len(SIGNATURES[name](types.float64).args), False)[0]


class MissingFormula:
    """Stands for the formula H of a system given by loops alone; raises InvalidInput when SymPy has to read it."""

    def _sympy_(self) -> NoReturn:
        raise InvalidInput("this system has loops and no formula to derive anything from; give its H as an expression")

    def __str__(self) -> str:
        return "H by its loop"


class HandHamiltonian(Hamiltonian):
    """The canonical system of H(q, p) whose functions are loops written by the user.

    Parameters
    ----------
    q, p : sequences of symbols or names, of equal length d; d is more than `codegen.TUPLE_LIMIT`, up to which states
        are tuples and not the arrays that the loops take
    H : expression, trusted to be what the loops compute; None if there is no formula
    loops : "energy", "field", "grad_V" or "grad_U" -> a function of the constants that returns the loop (the module
        `hand` says what each has to do); the first two are required
    constants : exact numbers (integers, fractions), passed to those functions as doubles or multiprecision numbers
    degree : the degree of H if it is a polynomial, else None
    invariants : conserved quantities, as expressions or as functions of arrays Q, P of shape (n, d)
    singular : distances that vanish where H is singular, in the same forms
    frequencies : d numbers, as in `Hamiltonian`

    Raises
    ------
    InvalidInput
        If d is at most `codegen.TUPLE_LIMIT`, or a required loop is missing.

    Examples
    --------
    >>> def energy(k):
    ...     def f(q, p):
    ...         H = 0 * q[0]
    ...         for i in range(len(q)):
    ...             H += p[i] * p[i] / 2 + k * q[i] * q[i] / 2
    ...         return H, 3 * H
    ...     return f
    >>> def field(k):
    ...     return lambda q, p, h, lam: (p.copy(), -k * q)
    >>> def grad_V(k):
    ...     return lambda q: k * q
    >>> loops = {"energy": energy, "field": field, "grad_V": grad_V}
    >>> names = [[f"{x}{i}" for i in range(1000)] for x in "qp"]
    >>> springs = HandHamiltonian(q=names[0], p=names[1], loops=loops, constants=(4,))
    >>> springs.d, springs.unit_mass
    (1000, True)
    """

    separable = False

    def __init__(
        self,
        *,
        q: Names,
        p: Names,
        loops: Mapping[str, Callable],
        H: sp.Expr | None = None,
        constants: Iterable[Any] = (),
        degree: int | None = None,
        invariants: Iterable[sp.Expr | Callable[..., Any]] = (),
        singular: Iterable[sp.Expr | Callable[..., Any]] = (),
        frequencies: Sequence[Formula | float] = (),
    ) -> None:
        self.q, self.p = _symbols(q), _symbols(p)
        self.d = len(self.q)
        if codegen.value_kind(self.d) == "tuple":
            raise InvalidInput(f"loops need more than {codegen.TUPLE_LIMIT} degrees of freedom; d is {self.d}")
        missing = [name for name in ("energy", "field") if name not in loops]
        if missing:
            raise InvalidInput(f"the loop '{missing[0]}' is missing; there are {', '.join(sorted(loops)) or 'none'}")
        self.H, self.loops, self.constants = MissingFormula() if H is None else H, loops, tuple(constants)
        self.singular, self.softened = tuple(singular), ()
        self.invariants, self.kepler = tuple(invariants), None
        self.frequencies = tuple(sp.sympify(w) for w in frequencies)
        self.polynomial_degree = degree
        self.separable = self.quadratic_kinetic = self.unit_mass = "grad_V" in loops
        self._functions: dict = {}

    @cached_property
    def dq(self) -> tuple[sp.Expr, ...]:
        """The expressions H_p, derived from the formula at the first access."""
        return tuple(sp.diff(self.H, x) for x in self.p)

    @cached_property
    def dp(self) -> tuple[sp.Expr, ...]:
        """The expressions -H_q, derived from the formula at the first access."""
        return tuple(-sp.diff(self.H, x) for x in self.q)

    def _loop(self, name: str, arithmetic: str) -> Function:
        constants = tuple(codegen.to_number(c, arithmetic) for c in self.constants)
        if arithmetic == DOUBLE and codegen.compiled():
            return _compile(name, self.loops[name], constants, self.fills, self.d)
        if ("loop", name, arithmetic) not in self._functions:
            self._functions["loop", name, arithmetic] = uncompiled_loop(name, self.loops[name], constants)
        return self._functions["loop", name, arithmetic]

    def field(self, arithmetic: str = DOUBLE, order: int = 1) -> Function:
        """The vector field, a user's loop (q, p, h, lam) -> (q', p'); for ``order`` > 1 derived from the formula."""
        return self._loop("field", arithmetic) if order == 1 else super().field(arithmetic, order)

    def grad_V(self, arithmetic: str = DOUBLE) -> Function:
        """The gradient of V, a user's loop q -> grad V(q)."""
        return self._loop("grad_V", arithmetic)

    def grad_U(self, arithmetic: str = DOUBLE) -> Function:
        """The gradient of the slow potential U(q): the user's loop, or derived from the formula if there is none."""
        return self._loop("grad_U", arithmetic) if "grad_U" in self.loops else super().grad_U(arithmetic)

    def energy(self, arithmetic: str = DOUBLE) -> Function:
        """The energy, a user's loop (q, p) -> (H, M), where the round-off of H is about eps M."""
        return self._loop("energy", arithmetic)

    @cached_property
    def constant(self) -> float:
        """The additive constant of H; 0 if there are loops and no formula."""
        return 0.0 if isinstance(self.H, MissingFormula) else super().constant

    def velocities(self, Q: ArrayLike, P: ArrayLike) -> Floats:
        """dq/dt at each row of Q, P (n, d): array (n, d), by the user's loop."""
        field = self.field()
        rows = zip(np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float), strict=True)
        return np.array([field(q, p, 0.0, 0.0)[0] for q, p in rows])

    def scale(self, Q: ArrayLike, P: ArrayLike) -> Floats:
        """The size of H's terms at each row of Q, P (n, d): array (n,).

        It is estimated as a third of the round-off unit M of H that the user's energy loop returns.
        """
        Q, P = np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float)
        energy = self.energy()
        with np.errstate(all="ignore"):
            return np.array([energy(q, p)[1] for q, p in zip(Q, P, strict=True)], float) / 3

    def energies(self, Q: ArrayLike, P: ArrayLike) -> Floats:
        """H at each row of Q, P (n, d): array (n,), by the user's loop."""
        Q, P = np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float)
        energy = self.energy()
        with np.errstate(all="ignore"):
            return np.array([energy(q, p)[0] for q, p in zip(Q, P, strict=True)], float)

    def observe(self, expression: Formula | MissingFormula | Callable[..., Any], Q: ArrayLike, P: ArrayLike) -> Floats:
        """Values of an expression in (q, p), or of a function of (Q, P), at each row of Q, P (n, d): array (n,).

        The formula H itself is evaluated by the user's loop.
        """
        Q, P = np.ascontiguousarray(Q, float), np.ascontiguousarray(P, float)
        if expression is self.H:
            return self.energies(Q, P)
        if callable(expression) and not isinstance(expression, sp.Basic):
            with np.errstate(all="ignore"):
                return np.asarray(expression(Q, P), float)
        return super().observe(expression, Q, P)
