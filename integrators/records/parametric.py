"""Records of the parameterized family of Wang, Bo and Cai: Schemes I-V, generating functions, their compositions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

from phasebench.integrators.coefficients.fractions import SCHEMES, times
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import CONSERVING, ROUND_OFF, SYMPLECTIC, Method

HALF = Fraction(1, 2)
TALK = "Wang, Bo & Cai (talk)"


def scheme_i(lam: Fraction | float) -> tuple[int, Fraction | float, Fraction | float]:
    """The substep (c, mu, lambda) of Scheme I of the parameterized family with the parameter lam: (1, 1 - lam, lam).

    c is the length as a fraction of the step.  The field is evaluated at (q + mu (Q - q), p + lambda (P - p)), where
    (q, p) is the old state and (Q, P) the new one.
    """
    return (1, 1 - lam, lam)


def scheme_iii(
    lam: Fraction | float, fractions: Iterable[Fraction | mpmath.mpf] = (Fraction(1),)
) -> tuple[tuple[Fraction | mpmath.mpf, Fraction | float, Fraction | float], ...]:
    """Substeps of Scheme III, as in `scheme_i`: Scheme I with 1 - lam, then with lam, each over half of a step.

    For a composition there are two such substeps for each of the ``fractions`` of the step.
    """
    halves = ((HALF, lam, 1 - lam), (HALF, 1 - lam, lam))
    return tuple((times(f, c), mu, la) for f in fractions for c, mu, la in halves)


def equip_rows(
    signs: tuple[int, ...], fractions: Iterable[Fraction | mpmath.mpf], alternative: tuple[int, ...]
) -> tuple[tuple[Fraction | mpmath.mpf, int, int, int], ...]:
    """Rows (c, sign, group, alternative) of the substeps of the energy-preserving Schemes IV and V.

    A substep has the length c h and evaluates the field at (q + (1 - lambda) (Q - q), p + lambda (P - p)), where (q, p)
    is the state before it and (Q, P) the state after it, with lambda = 1/2 + sign x.  The substeps over one of the
    ``fractions`` of the step are a group, numbered from 0; they share one x, chosen such that the energy is kept.
    Their signs are ``signs``, (1,) in Scheme IV and (-1, 1) in Scheme V, in rows with alternative 0.  Where no x keeps
    the energy, the signs ``alternative`` are tried, in rows with alternative 1.
    """
    rows = []
    for g, f in enumerate(fractions):
        for a, list_of_signs in enumerate((signs, alternative)):
            rows += [(times(f, Fraction(1, len(list_of_signs))), s, g, a) for s in list_of_signs]
    return tuple(rows)


def parameterised_method(*, make: Callable[..., dict[str, Any]], **facts: Any) -> Method:
    """Make the record of a method with a parameter lam, 1/3 by default.

    ``make(lam=...)`` returns the fields that depend on lam, such as the coefficients ``data``.
    """
    defaults = {"lam": Fraction(1, 3)} | facts.pop("parameters", {})
    common = SYMPLECTIC | {"family": "parametric", "requires": ("canonical",), "cite": ("wang-talk",)}
    return Method(parameters=defaults, with_parameters=make, **(common | facts | make(**defaults)))


def _generating(order: int, lam: Fraction | float) -> dict[str, Any]:
    if not 1 <= order <= 6:
        raise InvalidInput(f"the generating function is derived for orders 1 to 6, not {order}")
    even = order + 1 if lam == HALF and order % 2 else order
    return {"data": (order, (scheme_i(lam),)), "order": even, "symmetric": lam == HALF}


def _scheme_iii_composed(scheme: str, order: int) -> Method:
    return parameterised_method(
        id=f"scheme-iii-{scheme}-{order}",
        name=f"Scheme III, {scheme.capitalize()} composition of order {order}",
        source=f"{TALK}, (21); {scheme.capitalize()} 1990",
        make=lambda lam: {"data": lambda: (1, scheme_iii(lam, SCHEMES[scheme](order)))},
        order=order,
        cite=("wang-talk", f"{scheme}1990"),
    )


def equip_method(
    scheme: str,
    signs: tuple[int, ...],
    source: str,
    composed: str = "",
    alternative: tuple[int, ...] = (),
    **facts: Any,
) -> Method:
    """Make the record of the energy-preserving Scheme IV or V, or of its composition of order 4.

    Each fraction of a step has a parameter x, chosen to keep the energy, and a substep for each of the ``signs``, which
    evaluates the field with the weight lambda = 1/2 + sign x.  The signs ``alternative`` are tried if there is no such
    x (`equip_rows`).  The step is composed over fractions that the name ``composed`` has in `SCHEMES`, or is one.
    """
    common = CONSERVING | {"quadratic": ROUND_OFF, "requires": ("canonical",), "cite": ("wang-talk",), "order": 2}
    common |= {"id": f"scheme-{scheme}", "name": f"Scheme {scheme.upper()}", "source": source}
    return Method(
        family="schemes_iv_v",
        data=lambda: equip_rows(signs, SCHEMES[composed](4) if composed else (Fraction(1),), alternative),
        **(common | facts),
    )


def _scheme_iv_v_composed(scheme: str, signs: tuple[int, ...], composed: str, what: str) -> Method:
    return equip_method(
        scheme,
        signs,
        f"{TALK}; {composed.capitalize()} 1990",
        composed,
        id=f"scheme-{scheme}-{composed}-4",
        name=f"Scheme {scheme.upper()}, {what}",
        order=4,
        cite=("wang-talk", f"{composed}1990"),
    )


FOUR, FIVE = (1,), (-1, 1)

METHODS: tuple[Method, ...] = (
    parameterised_method(id="scheme-i", name="Scheme I", source=f"{TALK}, (19)", make=lambda lam: _generating(1, lam)),
    parameterised_method(
        id="scheme-i-adjoint",
        name="the adjoint of Scheme I",
        source=f"{TALK}, (10)",
        make=lambda lam: _generating(1, 1 - lam),
    ),
    parameterised_method(
        id="scheme-ii", name="Scheme II", source=f"{TALK}, (20)", make=lambda lam: _generating(2, lam)
    ),
    parameterised_method(
        id="generating-function",
        name="generating function of order r",
        source=f"{TALK}, (18); Feng et al. 1989",
        make=lambda order, lam: _generating(order, lam),
        parameters={"order": 3},
        cite=("wang-talk", "feng1989"),
    ),
    parameterised_method(
        id="scheme-iii",
        name="Scheme III",
        source=f"{TALK}, (21)",
        make=lambda lam: {"data": (1, scheme_iii(lam))},
        order=2,
    ),
    *(_scheme_iii_composed(scheme, order) for scheme in ("yoshida", "suzuki") for order in (4, 6)),
    equip_method("iv", FOUR, f"{TALK}, (24)"),
    equip_method("v", FIVE, TALK),
    equip_method("iv-v", FOUR, "phasebench", alternative=FIVE, name="Scheme IV, with Scheme V where it has no root"),
    equip_method("v-iv", FIVE, "phasebench", alternative=FOUR, name="Scheme V, with Scheme IV where it has no root"),
    _scheme_iv_v_composed("iv", FOUR, "yoshida", "triple jump"),
    _scheme_iv_v_composed("v", FIVE, "yoshida", "triple jump"),
    _scheme_iv_v_composed("v", FIVE, "suzuki", "Suzuki's fractal"),
)
BY_ID = {m.id: m for m in METHODS}
