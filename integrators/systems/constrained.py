r"""Hamiltonian systems with holonomic constraints g(q) = 0, with multipliers :math:`\lambda`:

.. math::
    \dot q = H_p,\qquad \dot p = -H_q - G(q)^T\lambda,\qquad g(q) = 0,\qquad G = g_q .

Differentiated once, the constraint is the *hidden* one, :math:`G H_p = 0`: the motion is on the manifold of all (q, p)
that fulfil both.  Differentiated twice it determines the multipliers as functions of (q, p),

.. math::
    (G H_{pp} G^T)\,\lambda = (G H_p)_q H_p - G H_{pp} H_q ,

which makes the *index-reduced* system :math:`\dot q = H_p, \dot p = -H_q - G^T\lambda(q, p)`: an ordinary differential
equation, on which any method runs.  Along it G H_p is constant and g grows linearly, so that errors leave the manifold.

The equations of the multipliers are eliminated symbol by symbol: a function is a sequence of intermediate results
(`printing.Program`), since the closed form of a solution grows exponentially with their number.

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VII.1, (1.5)-(1.9); E. Hairer,
G. Wanner, Solving Ordinary Differential Equations II (1996), VII.1.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.values import lane_formulae

from .formula import parse_equation
from .hamiltonian import Floats, Formula, Hamiltonian, Names, PartitionedSystem, _symbols
from .shared import Steps, factor, lighter_gradient, motion, slopes

if TYPE_CHECKING:
    from phasebench.integrators.compile.printing import Program
    from phasebench.integrators.values.kinds import Function

#: A start is on the manifold if its constraints are at most this many units of their round-off.
SLACK = 64.0
#: Iterations of a projection onto the manifold, and the change that ends it.
PROJECTIONS, SETTLED = 200, 1e-15
#: Steps of Newton's method from a state near the manifold.
RETRACTIONS = 8
#: The least ratio of singular values of constraints that are independent.
INDEPENDENT = 1e-10
#: Intermediate results of the closed form of the multipliers, at most.
LARGEST_CLOSED = 60


class ConstrainedHamiltonian(PartitionedSystem):
    """The Hamiltonian system of H(q, p) under holonomic constraints g_k(q) = 0.

    Its right-hand side is the index-reduced one, in which the multipliers are functions of (q, p).  Every method for
    ordinary differential equations runs on it, but drifts off the manifold of the constraints; methods for constraints
    (`families.rattle`, `families.manifold`) stay on the manifold.

    Parameters
    ----------
    q, p : sequences of symbols or names, of equal length d
    H : expression, or a formula as text (parsed, never evaluated as Python); G H_pp G^T must be regular
    constraints : m < d expressions g_k(q) or formulae, each to be zero; text may be an equation, "x**2 + y**2 = 1"
    singular : expressions, optional
        Distances that vanish where H is singular; found in H if not given.
    invariants : expressions, optional
        Quantities that the flow on the manifold conserves besides H and the constraints.

    Attributes
    ----------
    constraints : the expressions g_k(q)
    hidden : the expressions (G H_p)_k of the hidden constraints, with G = g_q: the time derivatives of the g_k
    free : the `Hamiltonian` without constraints

    Raises
    ------
    InvalidInput
        If a constraint has a momentum or no coordinate, or there are as many constraints as coordinates.

    Examples
    --------
    >>> pendulum = ConstrainedHamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + y", constraints=["x**2 + y**2 = 1"])
    >>> pendulum.hidden
    (2*u*x + 2*v*y,)
    """

    constrained = True

    def __init__(
        self,
        *,
        q: Names,
        p: Names,
        H: Formula,
        constraints: Sequence[Formula] | str,
        singular: Sequence[Formula] | None = None,
        invariants: Sequence[Formula] = (),
    ) -> None:
        q, p = _symbols(q), _symbols(p)
        self.free = Hamiltonian(q=q, p=p, H=H, singular=singular)
        PartitionedSystem.__init__(
            self, q=q, p=p, dq=self.free.dq, dp=self.free.dp, energy=self.free.H, invariants=invariants
        )
        #: The force -H_q without constraints.
        self.force = self.dp
        del self.dp
        self.singular, self.softened = self.free.singular, self.free.softened
        given = [constraints] if isinstance(constraints, (str, sp.Basic)) else list(constraints)
        self.constraints = tuple(self._constraint(e) for e in given)
        self._check_number()
        self.hidden = tuple(
            sp.Add(*(sp.diff(g, x) * v for x, v in zip(self.q, self.dq, strict=True))) for g in self.constraints
        )

    def _constraint(self, given: Formula) -> Any:
        """Convert a constraint to an expression g(q); raises InvalidInput if it has momenta or no coordinate."""
        if isinstance(given, str):
            given = parse_equation(given, {str(s): s for s in (*self.q, *self.p)})
        e = self._formula(given)
        momenta = sorted(map(str, e.free_symbols & {*self.p}))
        if momenta:
            raise InvalidInput(
                f"the constraint '{given}' has the momentum {momenta[0]}; only holonomic constraints g(q) = 0 are "
                "meant: that velocities are tangent to them follows"
            )
        if not e.free_symbols:
            raise InvalidInput(f"the constraint '{given}' has none of the coordinates {', '.join(map(str, self.q))}")
        return e

    def _check_number(self) -> None:
        m = len(self.constraints)
        if m == 0:
            raise InvalidInput("there is no constraint; without one the system is a Hamiltonian")
        if m >= self.d:
            what = "more constraints than coordinates" if m > self.d else "as many constraints as coordinates"
            raise InvalidInput(f"there are {what}, {m} and {self.d}: nothing could move; leave constraints out")

    # -- the index-reduced system -------------------------------------------------------------------------------------

    @cached_property
    def G(self) -> Any:
        """The Jacobian g_q of the constraints, a matrix of expressions of shape (m, d)."""
        return sp.Matrix([[sp.diff(g, x) for x in self.q] for g in self.constraints])

    @cached_property
    def _mobility(self) -> Any:
        """The matrix H_pp of shape (d, d): the inverse of the mass matrix where that is constant."""
        return sp.Matrix([[sp.diff(v, x) for x in self.p] for v in self.dq])

    @cached_property
    def shared(self) -> Program:
        """The index-reduced right-hand sides [q', p'] as a `Program`: expressions with named intermediate results.

        The last intermediate results are those of the elimination that gives the multipliers in p'.
        """
        from phasebench.integrators.compile.printing import Program

        steps = Steps()
        (H,) = steps.share_products([steps.flatten(self.H)])
        found = steps.gradient(H, [*self.q, *self.p])
        dq, force = found[self.d :], [-e for e in found[: self.d]]
        G = sp.Matrix([steps.gradient(e, self.q) for e in self.constraints])
        GM = G * self._mobility
        along = dict(zip(self.q, dq, strict=True))
        second = [steps.rate(steps.rate(e, along), along) for e in self.constraints]
        pushed = [factor(sp.Add(*(GM[i, j] * f for j, f in enumerate(force)))) for i in range(G.rows)]
        multipliers = steps.solve(GM * G.T, [a + b for a, b in zip(second, pushed, strict=True)])
        dp = [f - sum(G[i, j] * x for i, x in enumerate(multipliers)) for j, f in enumerate(force)]
        results = steps.finish([*dq, *dp])
        return Program(tuple(steps.definitions), [results[: self.d], results[self.d :]])

    @property
    def definitions(self) -> tuple[tuple[Any, Any], ...]:
        """The intermediate results (symbol, expression) that `sides` refer to, each after those that it needs."""
        return self.shared.definitions

    @property
    def sides(self) -> tuple[Any, ...]:
        """The 2 d right-hand sides, q' before p', in which symbols stand for intermediate results (`definitions`)."""
        dq, dp = self.shared.results
        return (*dq, *dp)

    @cached_property
    def dp(self) -> tuple[Any, ...]:  # type: ignore[override]
        """The right-hand sides p' in closed form; raises InvalidInput where that would be too long."""
        if len(self.definitions) > LARGEST_CLOSED:
            raise InvalidInput(
                f"p' of {len(self.constraints)} constraints has no short closed form; what asks for one cannot run"
            )
        known: dict = {}
        for symbol, e in self.definitions:
            known[symbol] = e.xreplace(known)
        return tuple(e.xreplace(known) for e in self.shared.results[1])

    @property
    def bound(self) -> dict[str, Any]:
        """The constraints g_k and hidden constraints (G H_p)_k: name -> expression.

        Solutions report them as invariants under these names, "constraint 1", ..., "hidden constraint 1", ...
        """
        kinds = {"constraint": self.constraints, "hidden constraint": self.hidden}
        return {f"{kind} {k}": e for kind, found in kinds.items() for k, e in enumerate(found, 1)}

    @cached_property
    def content(self) -> str:
        """A hash of the variables, H and the constraints; generated functions are cached under it."""
        text = "|".join([*map(str, (self.q, self.p)), *map(sp.srepr, (self.H, *self.constraints))])
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def elementary(self) -> bool:
        """True if the system can be evaluated in SIMD lanes (`PartitionedSystem.elementary`)."""
        few = codegen.value_kind(self.d) == "tuple"
        return few and lane_formulae.supported([*(e for _, e in self.definitions), *self.sides])

    @property
    def constant_mass(self) -> bool:
        """True if H = p . M^-1 p / 2 + V(q) with a constant M."""
        return self.free.quadratic_kinetic

    def field(self, arithmetic: str = DOUBLE, order: int = 1) -> Function:
        """Make the index-reduced vector field, a function f(q, p, h, lam) -> (q', p').

        It takes h and lam as that of `Hamiltonian.field`, and ignores them.  Raises InvalidInput unless ``order`` is 1.
        """
        if order != 1:
            raise InvalidInput("a system with constraints has no generating function in its coordinates")
        return self.field_like("field-1", lambda: self.shared, arithmetic)

    def rates(self, Q: Any, P: Any) -> Floats:
        """The index-reduced vector field y' = (q', p') at each row of Q, P (n, d): array (2 d, n)."""
        return self._columns("rates", lambda: (self.definitions, list(self.sides)), Q, P)

    def _columns(self, name: str, make: Callable[[], tuple], Q: Any, P: Any) -> Floats:
        """Values of expressions at each row of Q, P (n, d): array (number of expressions, n).

        ``make()`` returns (definitions of intermediate results, expressions); ``name`` identifies them in the cache.
        """
        from phasebench.integrators.compile.printing import Program, source

        if ("columns", name) not in self._functions:
            entry = f"w-{hashlib.sha256(f'{name}|{self.content}'.encode()).hexdigest()[:24]}.py"

            def text() -> str:
                return source("f", [("q", self.q), ("p", self.p)], Program(*make()), DOUBLE)

            self._functions["columns", name] = codegen.load_columnwise(codegen.cached_text(entry, text))
        with np.errstate(all="ignore"):
            found = self._functions["columns", name](np.asarray(Q, float).T, np.asarray(P, float).T)
        many = found if isinstance(found, tuple) else (found,)
        return np.array([np.broadcast_to(x, len(Q)).astype(float) for x in many])

    # -- functions that methods for constraints ask for ---------------------------------------------------------------

    def grad_V(self, arithmetic: str = DOUBLE) -> Function:
        """Make the function q -> grad V(q) of a separable H, without the constraint forces."""
        return self.gradient_like("grad_V", "q", lambda: slopes(self.free.potential, self.q), arithmetic)

    def grad_T(self, arithmetic: str = DOUBLE) -> Function | None:
        """The function p -> M^-1 p of an H with a constant mass matrix; None if that is p itself."""
        if self.free.unit_mass:
            return None
        return self.gradient_like("grad_T", "p", lambda: [list(self.dq)], arithmetic)

    def _solved(
        self,
        name: str,
        arguments: Sequence[tuple[str, Sequence[Any]]],
        equations: Callable[[], tuple[Any, Sequence[Any]]],
        result: Callable[[list[Any]], list[Any]],
        arithmetic: str,
    ) -> Function:
        """Make a function of vectors: ``result(mu)`` of the solution of A mu = b; ``equations()`` is (A, b)."""
        from phasebench.integrators.compile.printing import Program

        T = codegen.value_type(self.d)

        def results() -> Program:
            steps = Steps()
            found = result(steps.solve(*equations()))
            return Program(tuple(steps.definitions), [found])

        return self.make_function(name, arguments, results, T(*[T] * len(arguments)), arithmetic)

    def restore(self, arithmetic: str = DOUBLE) -> Function:
        r"""Make the function (q, q0) -> :math:`G(q_0)^T\mu`, a step of Newton's method for g(q - M^-1 G(q_0)^T mu) = 0.

        :math:`\mu = \bigl(G(q) M^{-1} G(q_0)^T\bigr)^{-1} g(q)`; M is the constant mass matrix.
        """
        first = self._named("first")

        def start() -> Any:
            return self.G.xreplace(dict(zip(self.q, first, strict=True)))

        return self._solved(
            "restore",
            [("q", self.q), ("first", first)],
            lambda: (self.G * self._mobility * start().T, self.constraints),
            lambda mu: self._pull(start(), mu),
            arithmetic,
        )

    def normal(self, arithmetic: str = DOUBLE) -> Function:
        r"""The function (q, p) -> :math:`G^T(G M^{-1} G^T)^{-1} G M^{-1} p`, the part of p that leaves the manifold.

        M^-1 is H_pp.  The part is subtracted from p to fulfil the hidden constraints; this is a step of Newton's
        method, and exact if M is constant.
        """
        return self._solved(
            "normal",
            [("q", self.q), ("p", self.p)],
            lambda: (self.G * self._mobility * self.G.T, self.hidden),
            lambda mu: self._pull(self.G, mu),
            arithmetic,
        )

    def free_field(self, arithmetic: str = DOUBLE) -> Function:
        """Make the function (q, p, h, lam) -> (H_p, -H_q), the field without constraints; it ignores h and lam."""
        return self.field_like("free field", lambda: motion(self.free, lighter_gradient), arithmetic)

    def mobility(self, arithmetic: str = DOUBLE) -> Function:
        """Make the function (q, p, x) -> H_pp(q, p) x, the product of a matrix (d, d) and a vector (d,)."""
        T = codegen.value_type(self.d)
        x = self._named("x")
        arguments = [("q", self.q), ("p", self.p), ("x", x)]
        results = lambda: [list(self._mobility * sp.Matrix(x))]  # noqa: E731
        return self.make_function("mobility", arguments, results, T(T, T, T), arithmetic)

    def pull(self, arithmetic: str = DOUBLE) -> Function:
        """Make the function (q, x) -> G(q)^T x, which uses only the first m components of x (d,)."""
        T, x = codegen.value_type(self.d), self._named("x")
        arguments = [("q", self.q), ("x", x)]
        return self.make_function(
            "transposed slopes", arguments, lambda: [self._pull(self.G, self._first(x))], T(T, T), arithmetic
        )

    def multipliers(self, arithmetic: str = DOUBLE) -> Function:
        r"""Make the function (q, q0, p0) -> :math:`\bigl(G(q) H_{pp}(q_0, p_0) G(q_0)^T\bigr)^{-1} g(q)`.

        It gives the corrections of the multipliers in a simplified Newton iteration for g(q) = 0, where (q0, p0) is the
        state at the start of the step and q a stage.  The m components of the result are padded with zeros to d.
        """
        first, way = self._named("first"), self._named("way")
        start = dict(zip((*self.q, *self.p), (*first, *way), strict=True))
        return self._solved(
            "multipliers",
            [("q", self.q), ("first", first), ("way", way)],
            lambda: (self.G * self._mobility.xreplace(start) * self.G.xreplace(start).T, self.constraints),
            lambda mu: [*mu, *[sp.Integer(0)] * (self.d - len(mu))],
            arithmetic,
        )

    def offset(self, arithmetic: str = DOUBLE) -> Function:
        r"""Make the function q -> :math:`G^T(G G^T)^{-1} g`, a step of Newton's method to be subtracted from q."""
        return self._solved(
            "offset",
            [("q", self.q)],
            lambda: (self.G * self.G.T, self.constraints),
            lambda mu: self._pull(self.G, mu),
            arithmetic,
        )

    def _named(self, letter: str) -> tuple[Any, ...]:
        """The d components of a further argument of a function."""
        return tuple(sp.Symbol(f"{x}_{letter}_", real=True) for x in self.q)

    def _first(self, x: Sequence[Any]) -> Sequence[Any]:
        return x[: len(self.constraints)]

    def _pull(self, G: Any, mu: Sequence[Any]) -> list[Any]:
        return [sp.Add(*(G[i, j] * x for i, x in enumerate(mu))) for j in range(self.d)]

    # -- the manifold -------------------------------------------------------------------------------------------------

    def defects(self, Q: ArrayLike, P: ArrayLike) -> tuple[Floats, Floats]:
        """Values (g, G H_p) of the constraints and hidden constraints at each row of Q, P (n, d): two arrays (m, n)."""
        found = self._columns("defects", lambda: ((), [*self.constraints, *self.hidden]), Q, P)
        return found[: len(found) // 2], found[len(found) // 2 :]

    def rounding(self, Q: Any, P: Any) -> Floats:
        """Estimate the round-off of constraints, then hidden constraints, at rows of Q, P (n, d): array (2 m, n)."""

        def sizes() -> tuple[tuple, list[Any]]:
            return (), [
                sp.Add(
                    *(sp.Abs(t) for t in sp.Add.make_args(e)),
                    *(sp.Abs(x * sp.diff(e, x)) for x in sorted(e.free_symbols, key=str)),
                )
                for e in (*self.constraints, *self.hidden)
            ]

        return float(np.finfo(float).eps) * self._columns("rounding", sizes, Q, P)

    @cached_property
    def _numbers(self) -> Callable[[Floats, Floats], tuple]:
        """The function (q, p) -> (g, G, G H_p, H_pp) of arrays (d,): arrays (m,), (m, d), (m,) and (d, d)."""
        parts = [sp.Matrix(self.constraints), self.G, sp.Matrix(self.hidden), self._mobility]
        f = sp.lambdify([(*self.q, *self.p)], parts, "numpy", cse=True)

        def values(q: Floats, p: Floats) -> tuple[Floats, Floats, Floats, Floats]:
            g, G, w, M = (np.asarray(x, float) for x in f((*map(float, q), *map(float, p))))
            return g[:, 0], G, w[:, 0], M

        return values

    @cached_property
    def constraint_values(self) -> Callable[[Floats], tuple[Floats, Floats]]:
        """The function q -> (g, G) of arrays (d,): arrays (m,) and (m, d)."""
        f = sp.lambdify([self.q], [sp.Matrix(self.constraints), self.G], "numpy", cse=True)

        def values(q: Floats) -> tuple[Floats, Floats]:
            g, G = (np.asarray(x, float) for x in f(tuple(map(float, q))))
            return g[:, 0], G

        return values

    def __getstate__(self) -> dict[str, Any]:
        """The attributes for pickling, without compiled functions, which are made again when they are needed."""
        return {k: v for k, v in super().__getstate__().items() if k not in ("_numbers", "constraint_values")}

    def nearest(self, q: ArrayLike, p: ArrayLike) -> tuple[Floats, Floats] | None:
        """The nearest state (q, p) on the manifold, in the metric of the mass matrix; None if none is found.

        First the q of least distance (q - q_0) . M (q - q_0) with g(q) = 0, then the p nearest in the metric of M^-1
        with G H_p = 0.  M is the inverse of H_pp at the start.
        """
        first, start = np.array(q, float), np.array(p, float)
        with np.errstate(all="ignore"):
            M = self._numbers(first, start)[3]
            if not np.isfinite(M).all() or np.linalg.eigvalsh((M + M.T) / 2)[0] <= 0:
                M = np.eye(self.d)
            try:
                found = self._nearest(first, start, M)
                way = start
                for _ in range(PROJECTIONS):
                    _, G, w, inverse = self._numbers(found, way)
                    step = G.T @ np.linalg.solve(G @ inverse @ G.T, w)
                    way = way - step
                    if not np.abs(step).max() > SETTLED * np.abs(way).max():
                        break
            except np.linalg.LinAlgError:
                return None
        good = np.isfinite([found, way]).all() and self._worst(found, way) is None
        return (found, way) if good else None

    def _nearest(self, first: Floats, p: Floats, M: Floats) -> Floats:
        """The q with g(q) = 0 of least distance from ``first`` in the metric M^-1, perhaps NaN; p are any momenta."""
        found = first
        for _ in range(PROJECTIONS):  # least squares with the constraints made linear
            g, G, _, _ = self._numbers(found, p)
            new = first - M @ G.T @ np.linalg.solve(G @ M @ G.T, g + G @ (first - found))
            change, found = np.abs(new - found).max(), new
            if not change > SETTLED * np.abs(found).max():
                return found
        from scipy.optimize import minimize

        W = np.linalg.inv(M)
        bound = {"type": "eq", "fun": lambda q: self._numbers(q, p)[0], "jac": lambda q: self._numbers(q, p)[1]}
        distance = {"fun": lambda q: (q - first) @ W @ (q - first) / 2, "jac": lambda q: W @ (q - first)}
        found = minimize(**distance, x0=first, method="SLSQP", constraints=[bound], options={"maxiter": 500}).x
        for _ in range(RETRACTIONS):
            g, G, _, _ = self._numbers(found, p)
            found = found - M @ G.T @ np.linalg.solve(G @ M @ G.T, g)
        return found

    def retract(self, q: Any, p: Any, arithmetic: str = DOUBLE) -> tuple[Any, Any]:
        """Project a state near the manifold onto it, along G^T by Newton's method; returns (q, p).

        q and p are arrays (d,) of doubles or MPFR numbers, as the arithmetic says.
        """
        if arithmetic == DOUBLE:
            for _ in range(RETRACTIONS):
                g, G, _, _ = self._numbers(q, p)
                q = q - G.T @ np.linalg.solve(G @ G.T, g)
            for _ in range(RETRACTIONS):
                _, G, w, M = self._numbers(q, p)
                p = p - G.T @ np.linalg.solve(G @ M @ G.T, w)
            return q, p
        offset, normal = self.offset(arithmetic), self.normal(arithmetic)
        for _ in range(RETRACTIONS):
            q = q - offset(q)
        for _ in range(RETRACTIONS):
            p = p - normal(q, p)
        return q, p

    def _worst(self, q: Floats, p: Floats, tangent: bool = True) -> tuple[str, Any, float] | None:
        """(Kind, expression, value) of the constraint that a state violates most, or None on the manifold.

        Hidden constraints count only if ``tangent``.
        """
        values = np.concatenate(self.defects(q[None], p[None]))[:, 0]
        excess = np.abs(values) / np.maximum(self.rounding(q[None], p[None])[:, 0], 1e-300)
        m = len(self.constraints)
        excess = excess if tangent else excess[:m]
        k = int(np.argmax(np.where(np.isfinite(excess), excess, np.inf)))
        if excess[k] <= SLACK:
            return None
        return ("constraint" if k < m else "hidden constraint", (*self.constraints, *self.hidden)[k], float(values[k]))

    def on_manifold(self, Q: Floats, P: Floats, tangent: Any = True) -> np.ndarray:
        """True for each row of Q, P (n, d) on the constraints, and if ``tangent`` (of each) on the hidden ones."""
        good = np.abs(np.array(self.defects(Q, P))) <= SLACK * self.rounding(Q, P).reshape(2, -1, len(Q))
        return good[0].all(0) & (good[1].all(0) | ~np.broadcast_to(tangent, len(Q)))

    def check_start(self, q: Floats, p: Floats, paste: str = "q0={}, p0={}", tangent: bool = True) -> None:
        """Raise InvalidInput for a start (q, p), arrays (d,), off the manifold, or where constraints are redundant.

        The message proposes the nearest start on the manifold; ``paste`` is the format string in which its q and p are
        written.  Hidden constraints are checked only if p must be ``tangent`` to the constraints.
        """
        self._check_independent(q, p)
        worst = self._worst(q, p, tangent)
        if worst is None:
            return
        kind, expression, value = worst
        text = f"the start is not on the constraints: the {kind} {expression} is {value:.3g} there, not 0"
        found = self.nearest(q, p)
        if found is None:
            raise InvalidInput(f"{text}, and no consistent start was found near it")
        lists = ([float(x) for x in part] for part in found)
        bare = paste.startswith("--")
        texts = (str(x).strip("[]").replace(" ", "") if bare else str(x) for x in lists)
        raise InvalidInput(f"{text}; the nearest consistent start is {paste.format(*texts)}")

    def _check_independent(self, q: Floats, p: Floats) -> None:
        """Raise InvalidInput if at (q, p) the Jacobian G has not full rank, or G H_pp G^T is singular."""
        with np.errstate(all="ignore"):
            _, G, _, M = self._numbers(q, p)
        if not (np.isfinite(G).all() and np.isfinite(M).all()):
            raise InvalidInput("the slopes of the constraints are not finite at the start")
        sizes = np.linalg.norm(G, axis=1)
        for k, size in enumerate(sizes):
            if size == 0:
                raise InvalidInput(
                    f"the constraint {self.constraints[k]} has no slope at the start: its G is zero there"
                )
        scaled = G / sizes[:, None]
        values = np.linalg.svd(scaled, compute_uv=False)
        if values[-1] < INDEPENDENT * values[0]:
            rank = int((values >= INDEPENDENT * values[0]).sum())
            raise InvalidInput(
                f"the constraints are redundant at the start: {len(sizes)} of rank {rank}; leave "
                f"{', '.join(self._redundant(scaled))} out"
            )
        gram = scaled @ M @ scaled.T
        if np.linalg.svd(gram, compute_uv=False)[-1] <= INDEPENDENT * np.linalg.norm(M, 2):
            raise InvalidInput("the multipliers are not determined at the start: G H_pp G^T is singular there")

    def _redundant(self, scaled: Floats) -> list[str]:
        """The constraints whose gradients, rows of ``scaled`` of length 1, depend linearly on earlier ones."""
        kept: list = []
        out = []
        for k, row in enumerate(scaled):
            trial = np.array([*kept, row])
            if np.linalg.svd(trial, compute_uv=False)[-1] < 1e-8:
                out.append(str(self.constraints[k]))
            else:
                kept.append(row)
        return out
