"""Random Hamiltonians with an initial state, a step and lambda, as Hypothesis strategies.

A formula is text over atoms: the variables themselves, or expressions that all Poisson-commute with a chosen linear or
bilinear function, which is then an invariant of any H built from the atoms. Every formula is smooth on all of phase
space; coefficients are multiples of 1/4, components of states of 1/16.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import combinations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from phasebench.integrators import Hamiltonian

#: Kinds of H: any, T(p) + V(q), p.M^-1 p / 2 + V(q), |p|^2 / 2 + V(q), a polynomial.
KINDS = ("any", "separable", "quadratic", "unit", "polynomial")
LARGEST = 3
WHOLE, SMALL = st.sampled_from((1, -1, 2, -2, 3, -3)), st.sampled_from((1, -1, 2, -2))
#: Values of lambda, some far outside [0, 1].
LAMBDAS = st.one_of(st.fractions(-1, 2, max_denominator=8), st.fractions(-40, 40, max_denominator=3))


@dataclass(frozen=True)
class Case:
    """A random Hamiltonian with an initial state, a step and a parameter of methods.

    Attributes
    ----------
    d : number of degrees of freedom
    H : formula of the Hamiltonian in q1, ..., qd, p1, ..., pd
    q, p : the initial state
    h, lam : the step, and lambda for the methods that take it
    fast : frequencies of a declared linear part, or ()
    linear : coefficients of an invariant linear in (q, p), or ()
    bilinear : rows of D of an invariant q.D p, or ()
    """

    d: int
    H: str
    q: tuple[Fraction, ...]
    p: tuple[Fraction, ...]
    h: Fraction
    lam: Fraction
    fast: tuple[Fraction, ...] = ()
    linear: tuple[int, ...] = ()
    bilinear: tuple[tuple[int, ...], ...] = ()

    @classmethod
    def read(cls, fields: dict) -> Case:
        """Make a case from a dict that was read from JSON, with fractions as text; invariants are left out."""
        d, H, q, p, h, lam, fast = (fields[x] for x in ("d", "H", "q", "p", "h", "lam", "fast"))
        return cls(
            d, H, *(tuple(map(Fraction, x)) for x in (q, p)), Fraction(h), Fraction(lam), tuple(map(Fraction, fast))
        )

    @property
    def system(self) -> Hamiltonian:
        return system(self.d, self.H, self.fast)


@cache
def system(d: int, H: str, fast: tuple = ()) -> Hamiltonian:
    """Build the `Hamiltonian` of a formula in q1, ..., qd, p1, ..., pd; ``fast`` has frequencies of a linear part."""
    q, p = names(d)
    return Hamiltonian(q=q, p=p, H=H, frequencies=fast)


def names(d: int) -> tuple[list[str], list[str]]:
    """Return the names of the variables: (["q1", ..., "qd"], ["p1", ..., "pd"])."""
    return [f"q{i + 1}" for i in range(d)], [f"p{i + 1}" for i in range(d)]


def squares(atoms) -> str:
    """Return the formula, as text, of half the sum of squares of the expressions ``atoms``."""
    return "(" + " + ".join(f"({a})**2" for a in atoms) + ")/2"


@st.composite
def term(draw, atoms, polynomial, degree):
    """Draw a formula (a Hypothesis strategy): a monomial in atoms, or a function of a linear combination of them.

    ``atoms`` are expressions as text.  A monomial has a degree from 2 to ``degree``; if ``polynomial``, only monomials
    are drawn.
    """
    c = draw(WHOLE)
    name = "" if polynomial else draw(st.sampled_from(("", "sin", "cos", "exp", "sqrt")))
    if not name:
        factors = draw(st.lists(st.sampled_from(atoms), min_size=2, max_size=degree))
        return f"({c})/4*" + "*".join(f"({a})" for a in factors)
    chosen = draw(st.lists(st.sampled_from(atoms), min_size=1, max_size=2))
    inner = " + ".join(f"({draw(WHOLE)})/2*({a})" for a in chosen)
    return f"({c})/4*{name}({f'1 + ({inner})**2' if name == 'sqrt' else inner})"


def terms(atoms, polynomial=False, degree=4):
    """Return a Hypothesis strategy for formulas: sums of two or three terms (see `term`) in the expressions ``atoms``.

    Choose a low ``degree`` if the atoms are quadratic themselves.
    """
    return st.lists(term(atoms, polynomial, degree), min_size=2, max_size=3).map(" + ".join)


@st.composite
def masses(draw, p):
    """Draw the formula of a kinetic energy p.M^-1 p / 2 with a diagonal M (a Hypothesis strategy)."""
    return " + ".join(f"{draw(st.sampled_from((1, 2, 3)))}*{x}**2/2" for x in p)


@st.composite
def complete(draw, d, H, **facts):
    """Draw a state without zero components, a step and lambda for a formula H: a `Case` (a Hypothesis strategy).

    ``facts`` are further fields of the case.
    """
    component = st.sampled_from([Fraction(s * n, 16) for n in range(2, 15) for s in (1, -1)])
    state = st.lists(component, min_size=d, max_size=d).map(tuple)
    h = draw(st.sampled_from([Fraction(1, n) for n in (32, 40, 64)]))
    return Case(d, H, draw(state), draw(state), h, draw(LAMBDAS), **facts)


@st.composite
def cases(draw, kind="any", largest=LARGEST, least=1):
    """Draw a `Case` of a kind of `KINDS`, or "fast" with a declared linear part (a Hypothesis strategy).

    The number d of degrees of freedom is between ``least`` and ``largest``.
    """
    d = draw(st.integers(least, largest))
    q, p = names(d)
    if kind == "fast":
        w = tuple(Fraction(draw(st.integers(1, 4)), 2) + k for k in range(d))
        H = f"{squares(p)} + " + " + ".join(f"({x})**2/2*{v}**2" for x, v in zip(w, q, strict=True))
        return draw(complete(d, f"{H} + {draw(terms(q))}", fast=w))
    if kind in ("any", "polynomial"):
        polynomial = kind == "polynomial"
        H = f"{squares([*q, *p])} + {draw(terms([*q, *p], polynomial))}"
        return draw(complete(d, H))
    T = {
        "separable": terms(p).map(lambda t: f"{squares(p)} + {t}"),
        "quadratic": masses(p),
        "unit": st.just(squares(p)),
    }
    return draw(complete(d, f"{draw(T[kind])} + {squares(q)} + {draw(terms(q))}"))


@st.composite
def with_linear(draw, kind="any", largest=LARGEST):
    """Draw a `Case` whose H has a linear invariant w.(q, p) (a Hypothesis strategy).

    For a kind other than "any" the invariant is a weighted total momentum, and T is quadratic.
    """
    d = draw(st.integers(2, largest))
    q, p = names(d)
    if kind != "any":
        w = draw(st.lists(SMALL, min_size=d, max_size=d))
        atoms = [f"({w[j]})*{q[i]} - ({w[i]})*{q[j]}" for i, j in combinations(range(d), 2)]
        H = f"{draw(masses(p))} + {squares(atoms)} + {draw(terms(atoms, degree=2))}"
        return draw(complete(d, H, linear=(*[0] * d, *w)))
    w = draw(st.lists(SMALL, min_size=2 * d, max_size=2 * d))
    rate = [*w[d:], *(-x for x in w[:d])]  # {y_i, w.y}; atoms are linear combinations of y that commute with w.y
    y = [*q, *p]
    atoms = [f"({rate[0]})*{y[i]} - ({rate[i]})*{y[0]}" for i in range(1, 2 * d)]
    return draw(complete(d, f"{squares(atoms)} + {draw(terms(atoms, degree=2))}", linear=tuple(w)))


def rotation(q, p):
    """Return (D, formulas of functions that rotations of (q1, q2) and (p1, p2) leave unchanged).

    Any H that is a function of these formulas has the invariant q.D p, D an array (d, d). The formulas include all
    other coordinates and momenta. ``q`` and ``p`` are names or formulas of the variables.
    """
    D = np.zeros((len(q), len(q)), int)
    D[0, 1], D[1, 0] = 1, -1
    atoms = [f"{q[0]}**2 + {q[1]}**2", f"{p[0]}**2 + {p[1]}**2", f"{q[0]}*{p[0]} + {q[1]}*{p[1]}"]
    return D, [*atoms, f"{q[0]}*{p[1]} - {q[1]}*{p[0]}", *q[2:], *p[2:]]


def dilation(q, p):
    """Return (D, formulas of functions that dilations q -> s q, p -> p / s of a plane leave unchanged).

    The plane is that of the first two coordinates.  Any H that is a function of these formulas has the invariant q.D p,
    as for `rotation`.
    """
    D = np.diag([1, 1, *[0] * (len(q) - 2)])
    return D, [f"{x}*{v}" for x in q[:2] for v in p[:2]] + [*q[2:], *p[2:]]


@st.composite
def with_bilinear(draw, kind="any", largest=LARGEST):
    """Draw a `Case` whose H has an invariant q.D p (a Hypothesis strategy).

    H is unchanged by rotations or dilations of a plane in sheared coordinates; for a kind other than "any", T is
    quadratic and the force central.
    """
    d = draw(st.integers(2, largest))
    q, p = names(d)
    if kind != "any":
        D, atoms = rotation(q, p)
        central = [atoms[0], *q[2:]]
        return draw(complete(d, f"{squares(p)} + {draw(terms(central, degree=2))} + ({atoms[0]})/2", bilinear=rows(D)))
    k = draw(SMALL)
    A, B = np.eye(d, dtype=int), np.eye(d, dtype=int)  # q -> A q, p -> B p with B = A^-T
    A[0, 1], B[1, 0] = k, -k
    sheared = [f"(q1 + ({k})*q2)", *q[1:]], ["p1", f"(p2 - ({k})*p1)", *p[2:]]
    D, atoms = draw(st.sampled_from((rotation, dilation)))(*sheared)
    return draw(complete(d, f"{' + '.join(atoms)} + {draw(terms(atoms, degree=2))}", bilinear=rows(A.T @ D @ B)))


def rows(D) -> tuple[tuple[int, ...], ...]:
    """Return the rows of a matrix as tuples of int."""
    return tuple(tuple(map(int, row)) for row in D)


def draws(strategy, n: int) -> list[Case]:
    """Draw n cases from a Hypothesis strategy, the same ones on every call."""
    found: list[Case] = []

    @settings(max_examples=n, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def look(case):
        found.append(case)

    look()
    return found
