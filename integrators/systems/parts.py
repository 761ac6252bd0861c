r"""A Hamiltonian as a sum of parts, each with its exact flow, which is derived from its formula.

A part is a sum of pieces that share no degree of freedom; the flow of a piece F over t is known where F is

- a *shear*, a function of variables none of which is another's conjugate: each of these stays, its conjugate moves by
  :math:`\mp t\,\partial F` (a function of q, one of p, :math:`p_\theta^2 / r^2`);
- a *monomial* of one degree of freedom, :math:`F = c\,q^a p^b` with integers a, b, and c a function of variables of
  other degrees of freedom, none of which is another's conjugate.  Since :math:`q^a p^b` is constant and
  :math:`(qp)' = (b - a) F`,

  .. math::
      q \to q\,(1 + \tau)^{b/(b-a)},\qquad p \to p\,(1 + \tau)^{-a/(b-a)},\qquad
      \tau = (b - a)\,t\,c\,q^{a-1}p^{b-1},

  and :math:`q\,e^{z},\ p\,e^{-z}` with :math:`z = a t c\,(qp)^{a-1}` if a = b;
- a *square*, :math:`F = (A q^2 + C p^2)/2` with numbers A, C not 0: a rotation, or a hyperbolic one.

Changes are computed without the difference of two near numbers: with :math:`u = (1 + \tau)^{1/n}` it is
:math:`u^m - 1 = \tau\,(1 + \dots + u^{m-1})/(1 + \dots + u^{n-1})`.

Source: Y. Wang, W. Sun, F. Liu, X. Wu, Astrophys. J. 907 (2021) 66, arXiv:2102.00373 (such parts of Schwarzschild's
geodesics); the general monomial is derived here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput

from .formula import parse
from .hamiltonian import Formula, Hamiltonian, Names, _expression, _symbols

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function

#: The end of the error message for a part without a known flow.
KINDS = (
    "a part may be a function of variables without their conjugates (V(q), T(p), p2**2/q1**2), a monomial "
    "c*q1**a*p1**b, or a*q1**2 + b*p1**2; split it further"
)
#: Largest power of a monomial.
LARGEST = 12


class SplitHamiltonian(Hamiltonian):
    """The canonical system of H = H_1 + ... + H_n, each of whose parts has an exact flow.

    Parameters
    ----------
    q, p : sequences of symbols or names, of equal length d
    parts : at least two expressions or formulae
        The exact flow of each must be known: a shear, a monomial or a square (see the module `parts`), or a sum of
        these in different degrees of freedom.
    H : expression or formula, optional
        The Hamiltonian, to check that the parts add up to it.
    singular, invariants : as in `Hamiltonian`

    Attributes
    ----------
    parts : the parts as expressions

    Raises
    ------
    InvalidInput
        If the flow of a part is not known, or the parts do not add up to H.

    Examples
    --------
    >>> one = SplitHamiltonian(q="r f", p="u v", parts=["u**2/2", "-u**2/r", "v**2/(2*r**2) - 1/r"])
    >>> one.traits["parts"], len(one.parts)
    (True, 3)
    """

    split = True

    def __init__(
        self,
        *,
        q: Names,
        p: Names,
        parts: Sequence[Formula],
        H: Formula | None = None,
        singular: Sequence[Formula] | None = None,
        invariants: Sequence[Formula] = (),
    ) -> None:
        q, p = _symbols(q), _symbols(p)
        names = {str(s): s for s in (*q, *p)}
        given = list(parts) if not isinstance(parts, str) else [parts]
        self.parts = tuple(_expression(parse(x, names) if isinstance(x, str) else x) for x in given)
        if len(self.parts) < 2:
            raise InvalidInput(f"there are {len(self.parts)} parts; give at least two, the sum of which is H")
        whole = sp.Add(*self.parts)
        if H is not None:
            wanted = _expression(parse(H, names) if isinstance(H, str) else H)
            rest = sp.simplify(wanted - whole)
            if rest != 0:
                raise InvalidInput(f"the parts do not add up to H: {rest} is left")
        self._derive(q=q, p=p, H=whole, singular=singular, invariants=invariants)
        self._flows = tuple(_flow(part, text, self.q, self.p) for part, text in zip(self.parts, given, strict=True))

    def part_flow(self, k: int, arithmetic: str = DOUBLE) -> Function:
        """Make the function (q, p, t) -> (change of q, change of p) of the exact flow of part k over the time t."""
        T = codegen.value_type(self.d)
        arguments = [("q", self.q), ("p", self.p), ("t", _time())]
        signature = types.Tuple((T, T))(T, T, types.float64)
        name = f"flow of the part {sp.srepr(self.parts[k])}"
        return self.make_function(name, arguments, lambda: [list(x) for x in self._flows[k]], signature, arithmetic)


def _time() -> Any:
    """The symbol that stands for the time of a flow in its formulae; its name has a blank, as no coordinate's has."""
    return sp.Symbol("flow time", real=True)


def _flow(part: Any, text: Formula, q: tuple[Any, ...], p: tuple[Any, ...]) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """The changes of q and of p, d expressions each, by the exact flow of a part over the time `_time`.

    Raises InvalidInput, which quotes the part's ``text``, if no exact flow is known.
    """
    dq, dp = {x: sp.Integer(0) for x in q}, {x: sp.Integer(0) for x in p}
    for piece in _pieces(part, q, p):
        for changes in (_shear, _monomial, _square):
            found = changes(piece, q, p)
            if found is not None:
                break
        else:
            raise InvalidInput(f"no exact flow of the part '{text}' is known: {KINDS}")
        for x, change in found.items():
            (dq if x in dq else dp)[x] += change
    return tuple(dq.values()), tuple(dp.values())


def _pieces(part: Any, q: tuple[Any, ...], p: tuple[Any, ...]) -> list[Any]:
    """Split a part into a list of sums that have no degree of freedom in common; leave constants out."""
    groups: list[tuple[set[int], Any]] = []
    for term in sp.Add.make_args(sp.expand(part)):
        degrees = {i for i, pair in enumerate(zip(q, p, strict=True)) if term.free_symbols & set(pair)}
        if not degrees:
            continue
        for group in [g for g in groups if g[0] & degrees]:
            groups.remove(group)
            degrees, term = degrees | group[0], term + group[1]
        groups.append((degrees, term))
    return [term for _, term in groups]


def _pairs(F: Any, q: tuple[Any, ...], p: tuple[Any, ...]) -> list[tuple[Any, Any]]:
    """The conjugate pairs (q_i, p_i) of which both are in F."""
    return [(x, y) for x, y in zip(q, p, strict=True) if F.has(x) and F.has(y)]


def _shear(F: Any, q: tuple[Any, ...], p: tuple[Any, ...]) -> dict | None:
    if _pairs(F, q, p):
        return None
    changes = {x: _time() * sp.diff(F, y) for x, y in zip(q, p, strict=True) if F.has(y)}
    return changes | {y: -_time() * sp.diff(F, x) for x, y in zip(q, p, strict=True) if F.has(x)}


def _monomial(F: Any, q: tuple[Any, ...], p: tuple[Any, ...]) -> dict | None:
    pairs = _pairs(F, q, p)
    if len(pairs) != 1:
        return None
    ((x, y),) = pairs
    a, b = (sp.simplify(s * sp.diff(F, s) / F) for s in (x, y))
    if not (a.is_Integer and b.is_Integer and max(abs(a), abs(b)) <= LARGEST):
        return None
    a, b = int(a), int(b)
    c = sp.simplify(F / (x**a * y**b))
    changes = {s: _time() * sp.diff(c, r) * x**a * y**b for s, r in zip(q, p, strict=True) if c.has(r)}
    changes |= {r: -_time() * sp.diff(c, s) * x**a * y**b for s, r in zip(q, p, strict=True) if c.has(s)}
    if a == b:
        z = a * _time() * c * (x * y) ** (a - 1)
        grown, shrunk = (2 * sp.sinh(s * z / 2) * sp.exp(s * z / 2) for s in (1, -1))
    else:
        tau, sign = (b - a) * _time() * c * x ** (a - 1) * y ** (b - 1), 1 if b > a else -1
        grown, shrunk = (_power_less_one(tau, m * sign, abs(b - a)) for m in (b, -a))
    return changes | {x: x * grown, y: y * shrunk}


def _power_less_one(tau: Any, m: int, n: int) -> Any:
    """The expression (1 + tau)^(m/n) - 1, for integers m and n > 0, in a form without cancellation for small tau."""
    u = (1 + tau) ** sp.Rational(1, n)
    ratio = tau * sum(u**j for j in range(abs(m))) / sum(u**j for j in range(n))
    return ratio if m >= 0 else -ratio / u ** (-m)


def _square(F: Any, q: tuple[Any, ...], p: tuple[Any, ...]) -> dict | None:
    pairs = _pairs(F, q, p)
    if len(pairs) != 1 or F.free_symbols != set(pairs[0]) or not F.is_polynomial(*pairs[0]):
        return None
    ((x, y),) = pairs
    terms = sp.Poly(F, x, y).as_dict()
    if set(terms) - {(0, 0)} != {(2, 0), (0, 2)}:
        return None
    A, C = 2 * terms[2, 0], 2 * terms[0, 2]
    if A * C > 0:
        w = sp.sqrt(A * C)
        less, s = -2 * sp.sin(w * _time() / 2) ** 2, sp.sin(w * _time()) / w
    else:
        w = sp.sqrt(-A * C)
        less, s = 2 * sp.sinh(w * _time() / 2) ** 2, sp.sinh(w * _time()) / w
    return {x: less * x + C * s * y, y: less * y - A * s * x}
