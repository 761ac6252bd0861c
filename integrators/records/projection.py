"""Make the records of projection and relaxation methods from the records of their base methods."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from phasebench.integrators.coefficients.fractions import SCHEMES, times
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.record import BOUNDED, DRIFT, DRIFTING, ROUND_OFF, Method

from . import classical, collocation, compositions, energy, parametric, splittings, variational

if TYPE_CHECKING:
    from phasebench.integrators.keywords import Value

ONTO = ("energy", "invariants")
FAMILIES = ("runge_kutta", "parametric", "splitting")


#: Id -> record of what may be projected or relaxed by its name.
MODULES = (classical, parametric, splittings, compositions, collocation, variational, energy)
BASES = {m.id: m for module in MODULES for m in module.METHODS}


def _method(base: Method | str, **parameters: Value) -> Method:
    if isinstance(base, Method):
        return base(**parameters)
    if base not in BASES:
        raise unknown_name("base method", base, BASES)
    return BASES[base](**parameters)


def _derive(base: Method, facts: Callable[[Method], dict], **fixed: Any) -> Method:
    """Make the record of a method that is derived from ``base``, with the same parameters.

    ``facts(base)`` returns the fields that depend on the values of the parameters, ``fixed`` are the other fields.
    """
    make = None
    if base.with_parameters is not None:

        def make(**values: Value) -> dict[str, Any]:
            return facts(base(**values))

    return Method(**fixed, **facts(base), parameters=base.parameters, with_parameters=make)


def projection_method(base: Method | str, onto: str = "energy", symmetric: bool = False, **parameters: Value) -> Method:
    """Make the record of the method that projects every step of ``base`` onto the initial values of invariants.

    Parameters
    ----------
    base : a method of the families `runge_kutta`, `parametric` and `splitting`, or its id
    onto : "energy", or "invariants" for the energy and all further invariants that the system declares
    symmetric : True for symmetric projection, which needs a symmetric base, False for standard projection
    parameters : values of the base's parameters

    Raises
    ------
    InvalidInput
        For a base of another family, a symmetric projection of a base that is not symmetric, or an unknown ``onto``.

    References
    ----------
    Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), IV.4 and V.4.1.
    """
    base = _method(base, **parameters)
    if base.family not in FAMILIES:
        raise InvalidInput(
            f"steps of '{base.id}' (family {base.family}) cannot be projected; methods of {', '.join(FAMILIES)} can"
        )
    if onto not in ONTO:
        raise InvalidInput(f"onto is {onto!r}; it must be one of {', '.join(ONTO)}")

    def facts(base: Method) -> dict:
        if symmetric and not base.symmetric:
            raise InvalidInput(f"'{base.label}' is not symmetric; its projection can only be the standard one")
        return {"order": base.order, "symmetric": symmetric, "data": (base, onto, symmetric)}

    kind = "symmetric-projection" if symmetric else "projected"
    suffix = "" if symmetric and onto == "energy" else f"-{onto}"
    target = "the energy" if onto == "energy" else "the energy and the further invariants"
    further = ("further invariants",) if onto == "invariants" else ()
    return _derive(
        base,
        facts,
        id=f"{base.id}-{kind}{suffix}",
        name=f"{base.name}, {'symmetric projection' if symmetric else 'projected'} onto {target}",
        family="projection",
        symplectic=False,
        energy=ROUND_OFF,
        quadratic=ROUND_OFF if further else BOUNDED if symmetric else DRIFT,
        source="Hairer 2000; Hairer, Lubich & Wanner 2006, V.4.1" if symmetric else f"{classical.HLW}, IV.4.2",
        cite=tuple(dict.fromkeys((*base.cite, *(("hairer2000",) if symmetric else ()), "hairer2006"))),
        requires=tuple(dict.fromkeys(("canonical", *base.requires, *further))),
    )


def relaxation_method(base: Method | str, adjust_time: bool = True, **parameters: Value) -> Method:
    """Make the record of the relaxation method of an explicit Runge-Kutta method, which adapts its steps to keep H.

    Parameters
    ----------
    base : a method of the family `runge_kutta` of order 2 at least, or its id
    adjust_time : True if the time advances by the relaxed length of a step; False if it advances by h, which is the
        incremental direction technique and loses an order
    parameters : values of the base's parameters

    Raises
    ------
    InvalidInput
        For a base of another family or of order 1, whose relaxation need not exist.

    References
    ----------
    D. I. Ketcheson, SIAM J. Numer. Anal. 57 (2019) 2850-2870.
    """
    base = _method(base, **parameters)
    if base.family != "runge_kutta" or base.order < 2:
        raise InvalidInput(f"'{base.id}' is no explicit Runge-Kutta method of order 2 or more; only those are relaxed")
    return _derive(
        base,
        lambda base: {"order": base.order - (not adjust_time), "data": (base, adjust_time)},
        id=f"{base.id}-{'relaxation' if adjust_time else 'incremental-direction'}",
        name=f"{base.name}, {'relaxation aimed at times n h' if adjust_time else 'incremental direction technique'}",
        family="relaxation",
        symmetric=False,
        symplectic=False,
        energy=ROUND_OFF,
        quadratic=DRIFT,
        source="Ketcheson 2019; Ranocha et al. 2020",
        cite=(*base.cite, "ketcheson2019", "ranocha2020"),
        requires=("canonical", *(t for t in base.requires if t != "canonical")),
    )


RK4, VERLET, MIDPOINT = BASES["rk4"], BASES["stormer-verlet"], BASES["implicit-midpoint"]
SUZUKI = classical.one_stage(
    (),
    id="suzuki-4",
    name="Stormer-Verlet with Suzuki's fractions of order 4",
    source="Suzuki 1990",
    order=4,
    cite=("suzuki1990",),
    data=lambda: (1, tuple((times(f, c), mu, lam) for f in SCHEMES["suzuki"](4) for c, mu, lam in VERLET.data[1])),
)
KUTTA_3 = Method(
    id="kutta-3",
    name="Kutta's method of order 3",
    family="runge_kutta",
    order=3,
    source="Kutta 1901",
    cite=("kutta1901",),
    data=((0, 0, 0), (Fraction(1, 2), 0, 0), (-1, 2, 0), (Fraction(1, 6), Fraction(2, 3), Fraction(1, 6))),
    **DRIFTING,
)

METHODS: tuple[Method, ...] = (
    projection_method(RK4),
    projection_method(RK4, onto="invariants"),
    projection_method(VERLET),
    projection_method(VERLET, symmetric=True),
    projection_method(MIDPOINT, symmetric=True),
    projection_method(MIDPOINT, onto="invariants", symmetric=True),
    projection_method(BASES["scheme-iii"], symmetric=True),
    projection_method(SUZUKI, symmetric=True),
    relaxation_method(RK4),
    relaxation_method(KUTTA_3),
    relaxation_method(BASES["dop853"]),
)
