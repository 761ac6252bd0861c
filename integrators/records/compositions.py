r"""Symmetric compositions of symmetric methods of order 2, over the fractions of `coefficients`.

.. math::
    \Psi_h = \Phi_{\gamma_s h} \circ \dots \circ \Phi_{\gamma_1 h},

with the step :math:`\Phi_h` of the base method and the fractions :math:`\gamma_k`.

Source: Hairer, Lubich, Wanner (2006), V.3.2; McLachlan, SIAM J. Sci. Comput. 16 (1995) 151-168.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from phasebench.integrators import coefficients
from phasebench.integrators.coefficients.fractions import DIGITS, times
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method

from . import classical, parametric, splittings

if TYPE_CHECKING:
    from fractions import Fraction

#: Fractions that do not add up to the step to this are no composition.
SUM = 1e-12
#: Families whose symmetric methods of order 2 can be composed.
COMPOSABLE = ("parametric", "schemes_iv_v", "rattle", "rigid")


def compose(base: Method, fractions: str | Sequence, **facts: Any) -> Method:
    """Make the record of the composition of a symmetric method of order 2 over fractions of the step.

    Parameters
    ----------
    base : the record of a symmetric method of order 2, of the family "parametric", "schemes_iv_v", "rattle" or "rigid";
        the composition has the same parameters
    fractions : the name of a composition in `coefficients`, or all the fractions
    facts : fields of the record that are to differ (id, name, source, order, ...); without an order it is computed
        from the fractions

    Raises
    ------
    InvalidInput
        If the base is not symmetric of order 2 or of another family, or the fractions do not add up to 1.
    """
    if isinstance(fractions, str):
        composition = coefficients.table(fractions)
        if not composition.gamma:
            raise InvalidInput(f"'{fractions}' is a splitting, no composition of a symmetric method")
        named = {"name": f"{base.name}, composed by {fractions}", "order": composition.classical_order}
        named |= {"source": composition.source, "cite": (*base.cite, *composition.cite), "id": f"{base.id}-{fractions}"}
        return _composed(base, lambda: coefficients.steps(fractions), named | facts)
    gamma = _exact(fractions)
    named = {"id": f"{base.id}-composed", "name": f"{base.name}, composed"}
    if "order" not in facts:
        named["order"] = _order(gamma)
    named["symmetric"] = all(abs(f - g) < SUM for f, g in zip(gamma, reversed(gamma), strict=True))
    return _composed(base, lambda: gamma, named | facts)


def _composed(base: Method, gamma: Callable[[], Sequence], facts: dict[str, Any]) -> Method:
    def of(base: Method) -> dict[str, Any]:
        _check(base)
        return {"data": lambda: _data(base, gamma())}

    changes = of(base)
    if base.with_parameters is not None:
        changes["with_parameters"] = lambda **values: of(base(**values))
    return replace(base, **(changes | facts))


def _check(base: Method) -> None:
    """Raise InvalidInput unless the method is symmetric, of order 2, and of a family of which steps are composed."""
    if base.family not in COMPOSABLE:
        raise InvalidInput(f"'{base.label}' is of the family {base.family}; only {', '.join(COMPOSABLE)} are composed")
    if not base.symmetric or base.order != 2:
        kind = "symmetric" if base.symmetric else "not symmetric"
        raise InvalidInput(f"'{base.label}' is {kind}, of order {base.order}; a base is symmetric, of order 2")


def _exact(fractions: Sequence[mpmath.mpf | Fraction | float | str]) -> tuple[mpmath.mpf, ...]:
    with mpmath.workdps(DIGITS):
        gamma = tuple(times(mpmath.mpf(1), mpmath.mpf(f) if isinstance(f, (str, float)) else f) for f in fractions)
        if not abs(mpmath.fsum(gamma) - 1) < SUM:
            raise InvalidInput(f"the fractions add up to {mpmath.nstr(mpmath.fsum(gamma), 17)}, not to 1")
    return gamma


def _order(gamma: tuple[mpmath.mpf, ...]) -> int:
    from phasebench.integrators.coefficients.order_conditions import classical_order

    return classical_order("composition", gamma, tolerance=SUM)


def _data(base: Method, gamma: Sequence[mpmath.mpf]) -> tuple:
    if base.family == "parametric":
        order, substeps = base.data
        return order, tuple((times(g, c), mu, lam) for g in gamma for c, mu, lam in substeps)
    if base.family == "rigid":
        scheme, fractions = base.data
        return scheme, tuple(times(g, c) for g in gamma for c in fractions)
    if base.family == "rattle":
        fractions, project = base.data
        return tuple(times(g, c) for g in gamma for c in fractions), project
    groups = 1 + max(row[2] for row in base.data)
    return tuple(
        (times(g, c), sign, k * groups + group, a) for k, g in enumerate(gamma) for c, sign, group, a in base.data
    )


BASES = classical.BY_ID | parametric.BY_ID
VERLET, MIDPOINT = BASES["stormer-verlet"], BASES["implicit-midpoint"]
COMPOSITIONS = tuple(t.name for t in coefficients.TABLES if t.gamma)
#: The fractions that are also taken with other bases than Stormer-Verlet; any others by `compose`.
BEST = (
    "yoshida-6a",
    "kahan-li-6",
    "sofroniou-spaletta-6",
    "kahan-li-8",
    "suzuki-umeno-8",
    "sofroniou-spaletta-8",
    "sofroniou-spaletta-10",
    "hlw-10",
)

METHODS: tuple[Method, ...] = (
    *(compose(VERLET, name, id=name) for name in COMPOSITIONS),
    compose(MIDPOINT, "forest-ruth", id="implicit-midpoint-yoshida-4"),
    compose(MIDPOINT, "suzuki-4"),
    *(compose(MIDPOINT, name) for name in BEST),
    *(compose(BASES["scheme-iii"], name) for name in BEST),
    *(compose(BASES["scheme-v"], name) for name in BEST if "10" not in name and name != "yoshida-6a"),
    # what a survey lists
    *(
        compose(VERLET, t.name, id=t.name) if t.gamma else splittings.record(t)
        for t in coefficients.GROUPS["collected"]
    ),
)
