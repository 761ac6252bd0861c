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
    """A random H of d degrees of freedom with an initial state, a step h and lambda.

    ``fast``: frequencies of a declared linear part; ``linear``: coefficients of an invariant linear in (q, p);
    ``bilinear``: rows of D of an invariant q.D p.
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
        """The case from a dict read from JSON, with fractions as text."""
        d, H, q, p, h, lam, fast = (fields[x] for x in ("d", "H", "q", "p", "h", "lam", "fast"))
        return cls(
            d, H, *(tuple(map(Fraction, x)) for x in (q, p)), Fraction(h), Fraction(lam), tuple(map(Fraction, fast))
        )

    @property
    def system(self) -> Hamiltonian:
        return system(self.d, self.H, self.fast)


@cache
def system(d: int, H: str, fast: tuple = ()) -> Hamiltonian:
    """The Hamiltonian of a formula in q1, ..., qd, p1, ..., pd."""
    q, p = names(d)
    return Hamiltonian(q=q, p=p, H=H, frequencies=fast)


def names(d: int) -> tuple[list[str], list[str]]:
    """Names of the variables: (q1, ..., qd), (p1, ..., pd)."""
    return [f"q{i + 1}" for i in range(d)], [f"p{i + 1}" for i in range(d)]


def squares(atoms) -> str:
    """Text of half the sum of squares of the expressions ``atoms``."""
    return "(" + " + ".join(f"({a})**2" for a in atoms) + ")/2"


@st.composite
def term(draw, atoms, polynomial, degree):
    """Formula of a monomial of degree 2 to ``degree``, or of a function of a linear combination of atoms."""
    c = draw(WHOLE)
    name = "" if polynomial else draw(st.sampled_from(("", "sin", "cos", "exp", "sqrt")))
    if not name:
        factors = draw(st.lists(st.sampled_from(atoms), min_size=2, max_size=degree))
        return f"({c})/4*" + "*".join(f"({a})" for a in factors)
    chosen = draw(st.lists(st.sampled_from(atoms), min_size=1, max_size=2))
    inner = " + ".join(f"({draw(WHOLE)})/2*({a})" for a in chosen)
    return f"({c})/4*{name}({f'1 + ({inner})**2' if name == 'sqrt' else inner})"


def terms(atoms, polynomial=False, degree=4):
    """Formula of a sum of two or three terms; choose a low ``degree`` if the atoms are quadratic themselves."""
    return st.lists(term(atoms, polynomial, degree), min_size=2, max_size=3).map(" + ".join)


@st.composite
def masses(draw, p):
    """A kinetic energy p.M^-1 p / 2 with a diagonal M of unequal entries."""
    return " + ".join(f"{draw(st.sampled_from((1, 2, 3)))}*{x}**2/2" for x in p)


@st.composite
def complete(draw, d, H, **facts):
    """Draw a state without zero components, a step and lambda for a formula H: a `Case`."""
    component = st.sampled_from([Fraction(s * n, 16) for n in range(2, 15) for s in (1, -1)])
    state = st.lists(component, min_size=d, max_size=d).map(tuple)
    h = draw(st.sampled_from([Fraction(1, n) for n in (32, 40, 64)]))
    return Case(d, H, draw(state), draw(state), h, draw(LAMBDAS), **facts)


@st.composite
def cases(draw, kind="any", largest=LARGEST, least=1):
    """A system of a kind of `KINDS`, or "fast" with a declared linear part, with least <= d <= largest."""
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
    """A system with a linear invariant w.(q, p); for a kind other than "any" a weighted total momentum."""
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
    """Functions that rotations of (q1, q2) and (p1, p2) leave unchanged: (D, their formulae), with q.D p the invariant.

    Any H of these formulae keeps q.D p. The other coordinates are formulae themselves.
    """
    D = np.zeros((len(q), len(q)), int)
    D[0, 1], D[1, 0] = 1, -1
    atoms = [f"{q[0]}**2 + {q[1]}**2", f"{p[0]}**2 + {p[1]}**2", f"{q[0]}*{p[0]} + {q[1]}*{p[1]}"]
    return D, [*atoms, f"{q[0]}*{p[1]} - {q[1]}*{p[0]}", *q[2:], *p[2:]]


def dilation(q, p):
    """As `rotation`, for dilations q -> s q, p -> p / s of the first two coordinates: (D, the unchanged formulae)."""
    D = np.diag([1, 1, *[0] * (len(q) - 2)])
    return D, [f"{x}*{v}" for x in q[:2] for v in p[:2]] + [*q[2:], *p[2:]]


@st.composite
def with_bilinear(draw, kind="any", largest=LARGEST):
    """A system with an invariant q.D p: rotations or dilations of a plane in sheared coordinates, or a central force if
    the kind asks for a quadratic T."""
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
    """Rows of a matrix as tuples of int."""
    return tuple(tuple(map(int, row)) for row in D)


def draws(strategy, n: int) -> list[Case]:
    """n cases of a strategy, the same ones on every call."""
    found: list[Case] = []

    @settings(max_examples=n, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def look(case):
        found.append(case)

    look()
    return found
