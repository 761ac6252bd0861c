r"""Hamiltonian and other partitioned systems, given by formulae: SymPy expressions or text.

A `Hamiltonian` is the system :math:`\dot q = H_p, \dot p = -H_q`; a `PartitionedSystem` is any
:math:`\dot q = a(q, p)`, :math:`\dot p = b(q, p)`, such as Lotka-Volterra in its own variables.  A system knows its
properties (*traits*, such as separable), which decide what methods apply, and generates on demand the compiled
functions (vector field, gradients, energy) that an integrator's loop calls.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from math import isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.values import inplace

from . import deferred, generating, magnetic, shared, singularities
from .formula import names, parse, time_hint

if TYPE_CHECKING:
    from phasebench.integrators.compile.printing import Program
    from phasebench.integrators.values.kinds import Function


def _symbols(names: Sequence[sp.Symbol | str] | str) -> tuple[sp.Symbol, ...]:
    if isinstance(names, str):
        names = names.replace(",", " ").split()
    return tuple(n if isinstance(n, sp.Symbol) else sp.Symbol(n, real=True) for n in names)


def _expression(e: object) -> sp.Expr:
    """Convert a formula to a SymPy expression; raises InvalidInput for other objects, such as a Python function."""
    try:
        found = sp.sympify(e)
    except (sp.SympifyError, TypeError, AttributeError):
        found = None
    if not isinstance(found, sp.Expr):
        kind = "a function of Python" if callable(e) else f"{e!r}"
        raise InvalidInput(f"a formula is {kind}; give a SymPy expression, or text such as 'p**2/2 - cos(q)'")
    return found


def read(e: object, known: Mapping[str, sp.Expr]) -> sp.Expr:
    """The expression of a formula, text in the ``known`` names or an expression of SymPy; raises InvalidInput."""
    return parse(e, known) if isinstance(e, str) else _expression(e)


#: A formula: text, or an expression of SymPy; the names of variables: text with spaces between, names, or symbols.
Formula: TypeAlias = "str | sp.Expr"
Names: TypeAlias = "str | Sequence[str | sp.Symbol]"
Floats = NDArray[np.float64]
#: Characters of a formula, or of a list of names, that a system prints.
SHOWN = 160


def _exact(parameters: Mapping[str, float]) -> dict[str, sp.Rational]:
    """The values of parameters as the exact doubles that they are; raises InvalidInput unless they are finite."""
    for name, value in parameters.items():
        if isinstance(value, bool) or not isinstance(value, Real) or not isfinite(value):
            raise InvalidInput(f"the parameter {name} is {value!r:.80}; it must be a finite number")
    return {name: sp.Rational(float(value)) for name, value in parameters.items()}


class PartitionedSystem:
    """The system q' = a(q, p), p' = b(q, p).

    Parameters
    ----------
    q, p : sequences of symbols or names, of equal length d
    dq, dp : sequences of d expressions or formulae, the right-hand sides
    energy : expression or formula, optional
        The invariant that is reported as the energy.
    singular : expressions, optional
        Distances that vanish where the system is singular.
    invariants : expressions, optional
        Further quantities that the exact flow conserves.

    Raises
    ------
    InvalidInput
        If the lengths differ or a formula has a symbol that is neither a coordinate nor a momentum.
    """

    canonical = False
    separable = False
    quadratic_kinetic = False
    #: Whether y' = B(y) grad H(y) with a structure matrix B that the system knows.
    poisson = False
    #: Whether coordinates are bound by constraints (`constrained`).
    constrained = False
    #: Whether the system is a rigid body in quaternions (`rigid`).
    rigid = False
    #: Whether H is a sum of parts with exact flows (`parts`).
    split = False
    #: Whether H depends on time, which is the last coordinate then; its momentum p_t takes up the energy.
    driven = False
    #: Whether that H is p . M^-1 p / 2 + V(q, t) with a constant M.
    driven_quadratic = False
    #: The values of names in the formulas, by name.
    parameters: Mapping[str, float] = {}
    #: Intermediate results (symbol, expression) that `sides` refer to.
    definitions: tuple[tuple[Any, Any], ...] = ()
    #: Hash that identifies the system in the cache (see `deferred`); empty if it is made of SymPy expressions.
    key = ""
    #: Functions written by hand, by name.
    loops: Mapping[str, Callable] = {}
    #: What the functions are compiled for if not for doubles, such as "8 lanes" (SIMD vectors of 8 doubles).
    variant = ""
    #: Whether functions write their results into arrays passed as arguments (`inplace.in_place_version`).
    fills = False

    def __init__(
        self,
        *,
        q: Names,
        p: Names,
        dq: Sequence[Formula],
        dp: Sequence[Formula],
        energy: Formula | None = None,
        singular: Sequence[Formula] = (),
        invariants: Sequence[Formula] = (),
    ) -> None:
        self.d: int
        self.H: Any
        self.q, self.p = _symbols(q), _symbols(p)
        if len(self.q) != len(self.p) or not self.q:
            raise InvalidInput(f"there are {len(self.q)} coordinates and {len(self.p)} momenta; give as many of each")
        if len({*self.q, *self.p}) != 2 * len(self.q):
            raise InvalidInput("a symbol stands twice among the coordinates and momenta")
        self.d = len(self.q)
        self.dq = tuple(self._formula(e) for e in dq)
        self.dp = tuple(self._formula(e) for e in dp)
        if len(self.dq) != self.d or len(self.dp) != self.d:
            raise InvalidInput(f"there are {len(self.dq)} and {len(self.dp)} right-hand sides for d = {self.d}")
        self.H = None if energy is None else self._formula(energy)
        self.singular = tuple(self._formula(e) for e in singular)
        self.softened: tuple[sp.Expr, ...] = ()
        self.invariants = tuple(self._formula(e) for e in invariants)
        self.frequencies: tuple[sp.Expr, ...] = ()
        self.kepler = None
        self._functions: dict = {}

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            # A stand-in (`deferred`) builds the system now; on any other system the attribute does not exist.
            if deferred.complete(self, name):
                return getattr(self, name)
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")

    def __repr__(self) -> str:
        """The variables and H, as in ``Hamiltonian(q='q', p='p', H='p**2/2 - cos(q)')``; long lists are shortened."""
        from textwrap import shorten

        q, p, H = self.q, self.p, self.H
        if self.driven:
            q, p, H = q[:-1], p[:-1], H - p[-1]
        parts = {"q": " ".join(map(str, q)), "p": " ".join(map(str, p))}
        if H is not None:
            parts["H" if self.canonical else "energy"] = str(H)
        said = (f"{name}={shorten(text, SHOWN, placeholder=' ...')!r}" for name, text in parts.items())
        return f"{type(self).__name__}({', '.join(said)})"

    def _formula(self, e: Formula) -> sp.Expr:
        known = {str(s): s for s in (*self.q, *self.p)} | _exact(self.parameters)
        e = read(e, known)
        e = e.xreplace({s: known[str(s)] for s in e.free_symbols if str(s) in self.parameters})
        foreign = e.free_symbols - {*self.q, *self.p}
        if "t" in map(str, foreign):
            raise InvalidInput(time_hint(self.d + 1))
        if foreign:
            known = ", ".join(map(str, (*self.q, *self.p)))
            raise InvalidInput(
                f"{', '.join(sorted(map(str, foreign)))} in the formula is none of the variables {known}"
            )
        return e

    @cached_property
    def polynomial_degree(self) -> int | None:
        """The degree of H where it is a polynomial of at least degree 1, else None."""
        if self.H is None or not self.H.is_polynomial(*self.q, *self.p):
            return None
        return sp.Poly(self.H, *self.q, *self.p).total_degree()

    @cached_property
    def traits(self) -> dict[str, object]:
        """The properties that decide which methods apply, such as "separable": name -> value, mostly booleans."""
        return self.recall("traits", self._traits)

    def _traits(self) -> dict[str, object]:
        return {
            "canonical": self.canonical,
            "separable": self.separable,
            "quadratic kinetic energy": self.quadratic_kinetic or self.driven_quadratic,
            "polynomial degree": self.polynomial_degree,
            "linear fast part": bool(self.frequencies),
            "Kepler part": self.kepler is not None,
            "Poisson structure": self.poisson,
            "further invariants": len(self.invariants) > 0,
            "singular distances": bool(singularities.steering_distances(self)),
            "elementary derivatives": self.canonical and not self.loops and self.elementary,
            "magnetic": magnetic.kind(self),
            "constrained": self.constrained,
            "rigid body": self.rigid,
            "parts": self.split,
            "constant mass matrix": self.constant_mass,
        }

    @property
    def bound(self) -> dict[str, Any]:
        """The constraint expressions by name; empty here, since only `ConstrainedHamiltonian` has constraints."""
        return {}

    @property
    def constant_mass(self) -> bool:
        """True if H = p . M^-1 p / 2 + V(q) with a constant M."""
        return self.quadratic_kinetic

    @property
    def sides(self) -> tuple[Any, ...]:
        """The 2 d right-hand sides, q' before p'; symbols may stand for intermediate results (`definitions`)."""
        return (*self.dq, *self.dp)

    @cached_property
    def shared(self) -> Program:
        """The right-hand sides [q', p'] as a `Program` that names the subexpressions they share (`systems.shared`)."""
        return shared.motion(self, shared.gradient)

    @property
    def elementary(self) -> bool:
        """True if the vector field can be evaluated at several states at once, in SIMD lanes (one state each).

        That takes few degrees of freedom, and right-hand sides made of sums, products, integer and half-integer powers,
        sin, cos, exp, sinh, cosh and tanh alone.
        """
        from phasebench.integrators.values import lane_formulae

        if codegen.value_kind(self.d) != "tuple":
            return False
        return lane_formulae.supported([*self.dq, *self.dp])

    @property
    def diagonal(self) -> bool:
        """True if H = sum p_i^2 / 2 m_i + V(q)."""
        return self.quadratic_kinetic and all(e.free_symbols <= {p} for e, p in zip(self.dq, self.p, strict=True))

    def recall(self, name: str, find: Callable[[], object]) -> Any:
        """Return the property of the system called ``name``: from the cache on disk, or computed by ``find()``.

        What ``find()`` returns has to be JSON-serializable; it is stored if the system has a key (see `deferred`).
        """
        if not self.key:
            return find()
        entry = f"k-{deferred.key_of(name, self.key)}.json"
        return json.loads(codegen.cached_text(entry, lambda: json.dumps(find())))

    # -- the functions that kernels ask for -----------------------------------------------------------------------

    @cached_property
    def content(self) -> str:
        """A hash of the variables, right-hand sides and H; generated functions are cached under it."""
        text = "|".join([*map(str, (self.q, self.p)), *map(sp.srepr, (*self.dq, *self.dp, self.H))])
        return hashlib.sha256(text.encode()).hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        """The attributes for pickling, without compiled functions, which are generated again when they are needed."""
        return self.__dict__ | {"_functions": {}}

    def make_function(
        self,
        kind: str,
        arguments: Sequence[tuple[str, Sequence[sp.Symbol] | sp.Symbol]],
        results: Callable[[], Program | Sequence[Any]],
        signature: Any,
        arithmetic: str,
    ) -> Function:
        """Generate a function of the system, compiled or in multiprecision, once for each ``kind`` and arithmetic.

        ``kind`` is a label that identifies the function in the cache, ``arguments`` are pairs (name, symbol or vector
        of symbols), ``signature`` is the Numba signature.  ``results()`` returns the expressions of the results, as
        `printing.source` takes them; it is called only if the function's text is not in the cache.
        """

        def text(arithmetic: str) -> str:
            from phasebench.integrators.compile import printing

            return printing.source("f", arguments, results(), arithmetic)

        if (kind, arithmetic) not in self._functions:
            key = f"{kind}|{self.content}"
            if self.fills:
                key, signature, text = f"{key}|fills", inplace.signature(signature), inplace.write_in_place(text)
            self._functions[kind, arithmetic] = codegen.function(key, text, signature, arithmetic)
        return self._functions[kind, arithmetic]

    def field_like(
        self,
        kind: str,
        results: Callable[[], Program | Sequence[Any]],
        arithmetic: str,
        h: sp.Symbol | None = None,
        lam: sp.Symbol | None = None,
    ) -> Function:
        """Generate a function (q, p, h, lam) -> two vectors, as `make_function` does; most ignore h and lam."""
        T, number = codegen.value_type(self.d, self.fills), types.float64
        scalars = [("h", h or sp.Symbol("h")), ("lam", lam or sp.Symbol("lam"))]
        signature = types.Tuple((T, T))(T, T, number, number)
        return self.make_function(kind, [("q", self.q), ("p", self.p), *scalars], results, signature, arithmetic)

    def gradient_like(self, kind: str, of: str, results: Callable[[], Any], arithmetic: str) -> Function:
        """Generate a function of q or p, by the name ``of``, with a vector as its result, as `make_function` does."""
        T = codegen.value_type(self.d, self.fills)
        return self.make_function(kind, [(of, self.q if of == "q" else self.p)], results, T(T), arithmetic)

    def field(self, arithmetic: str = DOUBLE, order: int = 1) -> Function:
        """Generate the vector field, a function f(q, p, h, lam) -> (q', p') of vectors of d numbers.

        For ``order`` 1 it ignores h and lam.  For ``order`` r > 1 the result is (S_p, -S_q), with S the generating
        function of the parameterized family (`generating`) with the parameter lam, divided by h and truncated after
        h^r: a step of length h with it has order r.
        """
        h = sp.Symbol("h", positive=True)

        def results() -> Program | list[list[sp.Expr]]:
            if order == 1:
                return shared.motion(self, shared.lighter_gradient)
            K = generating.coefficients(self.H, self.q, self.p, order)

            def slopes(variables: Sequence[sp.Symbol]) -> list[sp.Expr]:
                rows = zip(*(generating.gradient(k, variables) for k in K), strict=True)
                return [sum(slope * h**i for i, slope in enumerate(row)) for row in rows]

            return [slopes(self.p), [-e for e in slopes(self.q)]]

        return self.field_like(f"field-{order}", results, arithmetic, h, generating.LAMBDA)

    def energy(self, arithmetic: str = DOUBLE) -> Function:
        """Generate the function (q, p) -> (H, M), where eps M estimates the round-off of H.

        M is the sum of the absolute values of H's terms and of every x H_x, x a coordinate or momentum.
        """
        T = codegen.value_type(self.d)
        signature = types.UniTuple(types.float64, 2)(T, T)

        def results() -> list[sp.Expr]:
            terms = sum(sp.Abs(t) for t in sp.Add.make_args(self.H))
            return [self.H, terms + sum(sp.Abs(x * sp.diff(self.H, x)) for x in (*self.q, *self.p))]

        return self.make_function("energy-2", [("q", self.q), ("p", self.p)], results, signature, arithmetic)

    @cached_property
    def constant(self) -> float:
        """The additive constant of H, that is its term without variables; 0 if there is none."""
        return self.recall("constant", lambda: float(self.H.as_coeff_Add()[0]))

    @cached_property
    def _size(self) -> sp.Expr:
        """The sum of the absolute values of H's terms without the constant, with 1 in place of each sine and cosine."""

        def size(factor: sp.Expr) -> sp.Expr:
            base, n = factor.as_base_exp()
            wave = isinstance(base, (sp.sin, sp.cos)) and n.is_positive
            return sp.Integer(1) if wave else sp.Abs(factor)

        terms = (t for t in sp.Add.make_args(sp.expand_mul(self.H)) if t.free_symbols)
        return sp.Add(*(sp.Mul(*map(size, sp.Mul.make_args(t))) for t in terms))

    # -- values along rows of Q, P, each of shape (n, d); arrays of shape (n,) ---------------------------------------

    def observe(self, expression: Formula, Q: ArrayLike, P: ArrayLike) -> Floats:
        """The values of an expression in (q, p) at the rows of Q, P, arrays (n, d): array (n,)."""
        return self._along(codegen.load_columnwise(self._text(expression)), Q, P)

    def evaluate(self, name: str, expression: Callable[[], Any], Q: ArrayLike, P: ArrayLike) -> Floats:
        """Values of one of the system's own expressions at each row of Q, P (n, d): array (n,).

        ``name`` is its name in the cache; ``expression()`` derives it, and is called only if it is not cached.
        """
        if not self.key:
            return self.observe(expression(), Q, P)
        if ("observed", name) not in self._functions:
            entry = f"o-{deferred.key_of(name, self.key)}.py"
            text = codegen.cached_text(entry, lambda: self._text(expression()))
            self._functions["observed", name] = codegen.load_columnwise(text)
        return self._along(self._functions["observed", name], Q, P)

    def _text(self, expression: Formula) -> str:
        from phasebench.integrators.compile import printing

        return printing.columnwise_text(self.q, self.p, sp.sympify(expression))

    def _along(self, f: Callable[..., Any], Q: Any, P: Any) -> Floats:
        with np.errstate(all="ignore"):
            found = f(np.asarray(Q, float).T, np.asarray(P, float).T)
        if isinstance(found, np.ndarray) and found.shape == (len(Q),) and found.base is None and found.dtype == float:
            return found
        return np.broadcast_to(found, len(Q)).astype(float)

    @cached_property
    def has_energy(self) -> bool:
        """True if the system has an energy H."""
        return self.H is not None

    @cached_property
    def singularities(self) -> int:
        """The number of distances that vanish where the system is singular."""
        return len(self.singular)

    def energies(self, Q: ArrayLike, P: ArrayLike) -> Floats:
        """H at each row of Q, P (n, d): array (n,)."""
        return self.evaluate("energy", lambda: self.H, Q, P)

    def distances(self, Q: Any, P: Any) -> Floats:
        """The absolute distances to the singularities at each row of Q, P: array (singularities, n)."""
        found = [self.evaluate(f"distance {k}", lambda k=k: self.singular[k], Q, P) for k in range(self.singularities)]
        return np.abs(found).reshape(self.singularities, len(Q))

    def rates(self, Q: Any, P: Any) -> Floats:
        """The vector field y' = (q', p') at each row of Q, P (n, d): array (2 d, n)."""
        names = [(f"d{x}{k}", x, k) for x in "qp" for k in range(self.d)]
        sides = {"q": lambda k: self.dq[k], "p": lambda k: self.dp[k]}
        return np.array([self.evaluate(name, partial(sides[x], k), Q, P) for name, x, k in names])

    def scale(self, Q: ArrayLike, P: ArrayLike) -> Floats:
        """The size of H's terms, the sum of their absolute values, at each row of Q, P (n, d): array (n,)."""
        return self.evaluate("size", lambda: self._size, Q, P)

    def velocities(self, Q: ArrayLike, P: ArrayLike) -> Floats:
        """dq/dt at each row of Q, P (n, d): array (n, d)."""
        with np.errstate(all="ignore"):
            return np.stack([self.evaluate(f"dq{k}", lambda k=k: self.dq[k], Q, P) for k in range(self.d)], axis=1)

    def speed(self, Q: ArrayLike, P: ArrayLike) -> Floats:
        """The Euclidean norm of dq/dt at each row of Q, P (n, d): array (n,)."""
        with np.errstate(all="ignore"):
            return np.sqrt(sum(v**2 for v in self.velocities(Q, P).T))

    def vector_field(self, arithmetic: str = DOUBLE) -> Callable[[Any, np.ndarray], np.ndarray]:
        """Make the function (t, y) -> y' of arrays y = (q, p) of shape (2 d,), for other packages; t is ignored."""
        field, d = self.field(arithmetic), self.d
        tuples = codegen.compiled() and arithmetic == DOUBLE and codegen.value_kind(d) == "tuple"

        def f(t: Any, y: np.ndarray) -> np.ndarray:
            q, p = (tuple(map(float, y[:d])), tuple(map(float, y[d:]))) if tuples else (y[:d], y[d:])
            return np.concatenate([np.asarray(x) for x in field(q, p, 0.0, 0.0)])

        return f


def _flatten(given: Iterable[Any]) -> list:
    """A flat list of the items given, some of which are sequences."""
    return [y for x in given for y in (x if isinstance(x, (tuple, list)) else [x])]


def _names(formulas: Iterable[Formula]) -> set[str]:
    """The names that stand in formulas."""
    return {str(x) for e in formulas for x in (names(e) if isinstance(e, str) else _expression(e).free_symbols)}


def _derive_system(given: dict) -> Hamiltonian:
    """Build a `Hamiltonian` from its arguments, given as text, when a stand-in (`deferred`) needs its formulae."""
    system = Hamiltonian.__new__(Hamiltonian)
    system._derive(**given)
    return system


class Hamiltonian(PartitionedSystem):
    """The canonical system of H(q, p), or of H(q, p, t).

    Parameters
    ----------
    q, p : sequences of symbols or names, of equal length d
    H : expression, or a formula as text (parsed, never evaluated as Python).  If it has a t that is no coordinate, the
        system is that of H + p_t, with the time t as a further coordinate, and ``d`` counts it; initial states and the
        rows of `phasebench.integrate` leave it out
    singular : expressions, optional
        Distances that vanish where H is singular.  By default they are found in H (`singularities`), together with
        softened ones such as sqrt(r^2 + eps^2), which cannot vanish; an empty tuple says that there are none.
    invariants : expressions, optional
        Further quantities that the exact flow conserves.
    frequencies : d numbers, optional
        Declares the fast linear part: H = |p|^2 / 2 + sum omega_i^2 q_i^2 / 2 + U(q) with a slow U.
    kepler : optional `wisdom_holman.KeplerPart`
        Declares the Kepler part, the two-body problems into which a Wisdom-Holman method splits H (`wisdom_holman`).
    parameters : optional values of other names in the formulas, name -> number

    Raises
    ------
    InvalidInput
        If the lengths differ, frequencies are given without unit masses, or H has a symbol that is neither a
        coordinate nor a momentum, or no variable at all.

    Notes
    -----
    A system given as text that is in the cache is a stand-in, which derives expressions when they are read: `deferred`.

    Examples
    --------
    >>> pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    >>> pendulum.separable, pendulum.quadratic_kinetic
    (True, True)
    >>> Hamiltonian(q="q", p="p", H="p**2/2 - w**2*cos(q)", parameters={"w": 2})
    Hamiltonian(q='q', p='p', H='p**2/2 - 4*cos(q)')
    """

    canonical = True

    poisson = True

    def __init__(
        self,
        *,
        q: Names,
        p: Names,
        H: Formula,
        singular: Sequence[Formula] | None = None,
        invariants: Sequence[Formula] = (),
        frequencies: Sequence[Formula | float] = (),
        kepler: Any = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        given: dict[str, Any] = {"q": q, "p": p, "H": H, "invariants": invariants}
        given |= {} if singular is None else {"singular": singular}
        text = all(isinstance(x, str) for x in _flatten(given.values())) and type(self) is Hamiltonian
        if parameters:
            given |= {"parameters": dict(parameters)}
        if not text or frequencies or kepler is not None:
            given |= {"frequencies": frequencies, "kepler": kepler}
            self._derive(**given)
        else:
            vars(self).update(vars(deferred.system(deferred.key_of(given), partial(_derive_system, given))))
        self._given = given

    def with_parameters(self, **values: float) -> Hamiltonian:
        """The system of the same formulas with other values of some of its `parameters`; raises InvalidInput."""
        for name in values.keys() - self.parameters.keys():
            raise unknown_name("parameter of the system", name, self.parameters)
        return Hamiltonian(**self._given | {"parameters": {**self.parameters, **values}})

    def _derive(
        self,
        *,
        q: Names,
        p: Names,
        H: Formula,
        singular: Sequence[Formula] | None = None,
        invariants: Sequence[Formula] = (),
        frequencies: Sequence[Formula | float] = (),
        kepler: Any = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        """Set the attributes of the system: derive right-hand sides and distances to singularities from formulae."""
        q, p, (time, lost) = _symbols(q), _symbols(p), _symbols("t p_t")
        self.parameters, known = dict(parameters or {}), {str(s): s for s in (*q, *p)}
        double = [name for name in self.parameters if name in known]
        if double:
            raise InvalidInput(f"the parameter {double[0]} is one of the variables {', '.join(known)}")
        unused = self.parameters.keys() - (_names((H, *invariants, *(singular or ()))) if parameters else ())
        if unused:
            raise InvalidInput(f"the parameter {min(unused)} is in none of the formulas")
        known |= _exact(self.parameters)
        known.setdefault("t", time)
        H = read(H, known)
        H = H.xreplace({s: known[str(s)] for s in H.free_symbols if str(s) in self.parameters})
        if not H.free_symbols & {*q, *p}:
            raise InvalidInput("H depends on none of the coordinates and momenta")
        times = [x for x in H.free_symbols - {*q, *p} if str(x) == "t"]
        if times:
            self.driven = True
            q, p, H = (*q, time), (*p, lost), H.xreplace(dict.fromkeys(times, time)) + lost
        PartitionedSystem.__init__(
            self,
            q=q,
            p=p,
            dq=[sp.diff(H, x) for x in p],
            dp=[-sp.diff(H, x) for x in q],
            energy=H,
            singular=singular or (),
            invariants=invariants,
        )
        if singular is None:
            self.singular, self.softened = singularities.find(H, self.q, self.p)
        self.frequencies, self.kepler = tuple(sp.sympify(w) for w in frequencies), kepler
        if self.frequencies and (len(self.frequencies) != self.d or not self.unit_mass):
            raise InvalidInput(f"frequencies are {self.d} numbers of a system with H = |p|^2 / 2 + V(q)")

    @cached_property
    def _split(self) -> tuple[sp.Expr, sp.Expr] | None:
        """(T(p), V(q)) if H = T(p) + V(q), else None."""
        momenta, coordinates = set(self.p), set(self.q)
        for rewrite in (sp.sympify, sp.expand):  # an expansion takes long, and is seldom needed
            T, V = sp.Integer(0), sp.Integer(0)
            for term in sp.Add.make_args(rewrite(self.H)):
                if not term.free_symbols & momenta:
                    V += term
                elif not term.free_symbols & coordinates:
                    T += term
                else:
                    break
            else:
                return T, V
        return None

    @property
    def separable(self) -> bool:
        """True if H = T(p) + V(q)."""
        return self._split is not None

    @cached_property
    def quadratic_kinetic(self) -> bool:
        """True if H = p . M^-1 p / 2 + V(q) with a constant M."""
        return self._split is not None and self._is_quadratic(self._split[0])

    @property
    def driven_quadratic(self) -> bool:
        """True if H = p . M^-1 p / 2 + V(q, t) + p_t with a constant M."""
        return self.driven and self._split is not None and self._is_quadratic(self._split[0] - self.p[-1])

    def _is_quadratic(self, T: sp.Expr) -> bool:
        return bool(T.is_polynomial(*self.p)) and all(sum(m) == 2 for m in sp.Poly(T, *self.p).monoms())

    @cached_property
    def unit_mass(self) -> bool:
        """True if the velocity is the momentum itself."""
        return self.quadratic_kinetic and all(sp.expand(a - b) == 0 for a, b in zip(self.dq, self.p, strict=True))

    @cached_property
    def inverse_masses(self) -> tuple[sp.Rational, ...] | None:
        """1 / m_i of H = sum p_i^2 / 2 m_i + V(q) with rational masses, not all of them one; None for any other H."""
        if not self.quadratic_kinetic or self.unit_mass:
            return None
        found = tuple(sp.diff(v, p) for v, p in zip(self.dq, self.p, strict=True))
        alone = all(v.free_symbols <= {p} for v, p in zip(self.dq, self.p, strict=True))
        return found if alone and all(c.is_Rational for c in found) else None

    @property
    def kinetic(self) -> sp.Expr | None:
        """The kinetic energy T(p) of a separable H; else None."""
        return None if self._split is None else self._split[0]

    @property
    def potential(self) -> sp.Expr | None:
        """The potential V(q) of a separable H; else None."""
        return None if self._split is None else self._split[1]

    def grad_T(self, arithmetic: str = DOUBLE) -> Function | None:
        """The function p -> grad T(p) of a separable H; None if that is p itself."""
        if self.unit_mass:
            return None
        return self.gradient_like("grad_T", "p", lambda: [[sp.diff(self.kinetic, x) for x in self.p]], arithmetic)

    def inertia(self, arithmetic: str = DOUBLE) -> Function:
        """The function v -> M^-1 v of H = p . M^-1 p / 2 + V(q, t) + p_t."""
        T = self.kinetic - self.p[-1]
        return self.gradient_like("inertia", "p", lambda: [[sp.diff(T, x) for x in self.p]], arithmetic)

    def grad_V(self, arithmetic: str = DOUBLE) -> Function:
        """The function q -> grad V(q) of a separable H."""
        return self.gradient_like("grad_V", "q", lambda: shared.slopes(self.potential, self.q), arithmetic)

    @property
    def slow_potential(self) -> sp.Expr:
        """The slow potential U(q): V(q) without the fast linear part."""
        return sp.expand_mul(
            self.potential - sum(w**2 * x**2 for w, x in zip(self.frequencies, self.q, strict=True)) / 2
        )

    def grad_U(self, arithmetic: str = DOUBLE) -> Function:
        """The function q -> grad U(q) of the slow potential U, for a system with a fast linear part."""
        kind = f"grad_U {self.frequencies}"
        return self.gradient_like(kind, "q", lambda: [[sp.diff(self.slow_potential, x) for x in self.q]], arithmetic)

    def hessian(self) -> sp.Matrix:
        """The matrix of second derivatives of H with respect to (q, p), of shape (2 d, 2 d), as expressions."""
        return sp.hessian(self.H, [*self.q, *self.p])
