"""Write expressions as a sequence of intermediate results that they share, and differentiate such a sequence.

Every inner sum gets a symbol of its own, such as a difference of coordinates, a squared distance or the sum in a
denominator, and so does a product that stands in several terms.  A gradient is found by going back through the
results, each of which is differentiated as it stands (reverse mode): a force between two points is then one number,
times the difference of their coordinates.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

from phasebench.integrators.compile.lazy import sympy as sp

if TYPE_CHECKING:
    from phasebench.integrators.compile.printing import Program

    from .hamiltonian import PartitionedSystem

#: Shared forms that leave more than this share of the products gain nothing in machine code: it waits for results.
LIGHTER = 2 / 3


class Steps:
    """A growing list of intermediate results, ``definitions``: pairs (symbol, expression), in order of evaluation.

    ``letter`` begins the names of their symbols.
    """

    def __init__(self, letter: str = "k") -> None:
        self.letter = letter
        self.definitions: list[tuple[Any, Any]] = []
        self._names: dict[Any, Any] = {}

    def _symbol(self, e: Any) -> Any:
        """The symbol of an intermediate result, which is a new one unless it has been defined."""
        if e not in self._names:
            self._names[e] = sp.Symbol(f"{self.letter}{len(self._names)}_", real=True)
            self.definitions.append((self._names[e], e))
        return self._names[e]

    def name(self, e: Any) -> Any:
        """Return a number times a symbol for an expression, and a new symbol only if none is known."""
        number, rest = e.as_coeff_Mul()
        if rest.is_Add:
            content = _content(rest.args)
            content = -content if rest.could_extract_minus_sign() else content
            number, rest = number * content, rest if content == 1 else sp.Add(*(x / content for x in rest.args))
        return e if rest.is_Symbol or rest.is_number else number * self._symbol(rest)

    def flatten(self, e: Any) -> Any:
        """Name the sums and functions inside an expression and return it in these names."""
        if not e.args or e.is_number:
            return e
        args = [self.flatten(a) for a in e.args]
        if e.is_Add:
            return sp.Add(*args)
        e = e.func(*(self.name(a) if a.is_Add else a for a in args))
        return self.name(e) if e.is_Function else e

    def gradient(self, e: Any, variables: Sequence[Any]) -> list[Any]:
        """The derivatives of an expression with respect to the variables, in terms of ``definitions``."""
        parts: dict[Any, list] = defaultdict(list)

        def push(local: Any, weight: Any) -> None:
            slopes = {x: sp.diff(local, x).xreplace(self._names) for x in sorted(local.free_symbols, key=str)}
            content = _content(slopes.values())
            weight = factor(sp.Add(*(content * w for w in sp.Add.make_args(weight))))
            weight = self._symbol(weight) if len(slopes) > 1 and weight.args else weight
            for x, slope in slopes.items():
                parts[x].append(weight * slope / content)

        push(self.flatten(e), sp.Integer(1))
        for symbol, local in reversed(list(self.definitions)):
            if symbol in parts:
                push(local, sp.Add(*parts.pop(symbol)))
        return [factor(sp.Add(*parts[x])) for x in variables]

    def rate(self, e: Any, rates: Mapping[Any, Any]) -> Any:
        """The derivative of an expression along rates of its variables, variable -> expression."""
        e, known = self.flatten(e), dict(rates)
        defined = dict(self.definitions)

        def of(x: Any) -> Any:
            if x not in known:
                known[x] = self.name(along(defined[x])) if x in defined else sp.Integer(0)
            return known[x]

        def along(local: Any) -> Any:
            return factor(sp.Add(*(sp.diff(local, x) * of(x) for x in sorted(local.free_symbols, key=str))))

        return along(e)

    def solve(self, A: Any, b: Sequence[Any]) -> list[Any]:
        """Return the solution x of A x = b, a list of m symbols or numbers; A is a matrix (m, m), b a sequence (m,).

        By elimination without pivoting, of a symmetric matrix in half the operations.
        """
        m = len(b)
        symmetric = A == A.T
        A = [[self.name(A[i, j]) for j in range(m)] for i in range(m)]
        b, pivots = [self.name(x) for x in b], []
        for k in range(m):
            pivots.append(self.name(1 / A[k][k]))
            for i in range(k + 1, m):
                below = A[k][i] if symmetric else A[i][k]
                if below == 0:
                    continue
                multiple = self.name(below * pivots[k])
                for j in range(i if symmetric else k + 1, m):
                    if A[k][j] != 0:
                        A[i][j] = self.name(A[i][j] - multiple * A[k][j])
                b[i] = self.name(b[i] - multiple * b[k])
        x: list[Any] = [None] * m
        for k in reversed(range(m)):
            x[k] = self.name((b[k] - sum(A[k][j] * x[j] for j in range(k + 1, m))) * pivots[k])
        return x

    def finish(self, expressions: Sequence[Any]) -> list[Any]:
        """Share products, and leave out the definitions that the expressions do not need; return the expressions."""
        expressions = self.share_products(expressions)
        needed = set().union(*(e.free_symbols for e in expressions))
        kept = []
        for symbol, e in reversed(self.definitions):
            if symbol in needed:
                needed |= e.free_symbols
                kept.append((symbol, e))
        self.definitions[:] = kept[::-1]
        return expressions

    def share_products(self, expressions: Sequence[Any]) -> list[Any]:
        """Name pairs of factors that stand in several products, as such or to another power; return the expressions."""
        from phasebench.integrators.compile.printing import in_order_of_evaluation

        expressions = list(expressions)
        while True:
            every = [*(e for _, e in self.definitions), *expressions]
            groups: dict[tuple, set] = defaultdict(set)
            products = set().union(*(e.atoms(sp.Mul) for e in every))
            for product in products:
                for (a, n), (b, m) in combinations(_powers(product), 2):
                    groups[a, b, m / n].add((product, n))
            best = max(groups, key=lambda g: (len(groups[g]), str(g)), default=None)
            if best is None or len(groups[best]) < 2:
                return expressions
            a, b, ratio = best
            exponents = [n for _, n in groups[best]]
            unit = sp.gcd_list(exponents) * (1 if max(exponents) > 0 else -1)  # its inverse may be infinite
            unit /= max(1, sp.gcd(unit, ratio * unit))  # x y, of which x^2 y^2 is the square
            shared = a**unit * b ** (ratio * unit)
            symbol = self._symbol(shared)
            self.definitions.pop()
            new = {}
            for product in products:
                powers = dict(_powers(product))
                times = min((powers.get(x, 0) / n for x, n in ((a, unit), (b, ratio * unit))), key=abs)
                times = sp.Integer(int(times))
                if times and powers[a] / unit * times > 0 and powers[b] / (ratio * unit) * times > 0:
                    new[product] = product / shared**times * symbol**times
            renamed = ((s, e.xreplace(new)) for s, e in self.definitions)
            self.definitions[:] = in_order_of_evaluation([(symbol, shared), *renamed])
            self._names = {e: s for s, e in self.definitions}
            expressions = [e.xreplace(new) for e in expressions]


def gradient(e: Any, variables: Sequence[Any]) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """The derivatives of an expression in shared form: (definitions, derivatives in terms of them)."""
    steps = Steps()
    (e,) = steps.share_products([steps.flatten(e)])
    return steps.definitions, steps.finish(steps.gradient(e, variables))


def lighter_gradient(e: Any, variables: Sequence[Any]) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """The derivatives of an expression as `gradient`, or without definitions unless these save many products."""
    plain, shared = ([], [sp.diff(e, x) for x in variables]), gradient(e, variables)
    return shared if _work(*shared) < LIGHTER * _work(*plain) else plain


def motion(system: PartitionedSystem, gradient: Callable[..., tuple]) -> Program:
    """The right-hand sides [q', p'] of a system; those of H(q, p) are its derivatives by ``gradient``."""
    from phasebench.integrators.compile.printing import Program

    if not system.canonical:
        definitions, sides = system.definitions, system.sides
    else:
        definitions, found = gradient(system.H, [*system.p, *system.q])
        sides = (*found[: system.d], *(-e for e in found[system.d :]))
    return Program(definitions, [list(sides[: system.d]), list(sides[system.d :])])


def slopes(e: Any, variables: Sequence[Any], sign: int = 1) -> Program:
    """The derivatives of an expression, times a sign, as a `Program` of one vector for machine code."""
    from phasebench.integrators.compile.printing import Program

    definitions, found = lighter_gradient(e, variables)
    return Program(definitions, [[sign * x for x in found]])


def _work(definitions: Sequence[tuple[Any, Any]], expressions: Sequence[Any]) -> int:
    """The number of products, also those in powers, with common subexpressions counted once."""
    from phasebench.integrators.compile.printing import share

    ordered, flat = share(definitions, expressions)
    parts = [x for e in (*(e for _, e in ordered), *flat) for x in sp.preorder_traversal(e)]
    powers = sum(max(1, abs(int(x.exp)) - 1) for x in parts if x.is_Pow and x.exp.is_Rational)
    return powers + sum(len(x.args) - (2 if x.args[0] == -1 else 1) for x in parts if x.is_Mul)


def _content(terms: Iterable[Any]) -> Any:
    """The size of the numbers in front of all terms where these are equal up to their signs, else 1."""
    sizes = {abs(x.as_coeff_Mul()[0]) for x in terms}
    return sizes.pop() if len(sizes) == 1 else sp.Integer(1)


def _powers(product: Any) -> list[tuple[Any, Any]]:
    """The factors of a product with variables as pairs (base, rational exponent)."""
    found = (f.as_base_exp() for f in product.args)
    return sorted(((b, n) for b, n in found if n.is_Rational and not b.is_number), key=str)


def _products(term: Any) -> int:
    """The number of products of variables in a term."""
    return max(0, sum(not f.is_number for f in sp.Mul.make_args(term)) - 1)


def factor(e: Any) -> Any:
    """Take common factors out of the terms of a sum where that saves products."""
    if not e.is_Add:
        return e
    groups: dict[tuple, list[tuple[Any, Any]]] = defaultdict(list)
    for term in e.args:
        for base, n in _powers(sp.Mul(term, evaluate=False) if not term.is_Mul else term):
            groups[base, n > 0, n.q].append((term, n))
    best = None
    for (base, positive, _), found in groups.items():
        common = base ** (min if positive else max)(n for _, n in found)
        inner = [term / common for term, _ in found]
        saved = sum(_products(term) for term, _ in found) - 1 - sum(map(_products, inner))
        if saved > 0 and (best is None or (saved, str(base)) > best[:2]):
            best = saved, str(base), common, inner, [term for term, _ in found]
    if best is None:
        return e
    _, _, common, inner, terms = best
    return common * factor(sp.Add(*inner)) + factor(e - sp.Add(*terms))
