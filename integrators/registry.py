"""METHODS: every method, one record each.

A new method of a family that exists is one more record here (see CONTRIBUTING).
"""

from __future__ import annotations

from fractions import Fraction

from .composition import SCHEMES, times
from .errors import InvalidInput, unknown
from .record import BOUNDED, DRIFT, ROUND_OFF, Method

HALF = Fraction(1, 2)
TALK = "Wang, Bo & Cai (talk)"
HLW = "Hairer, Lubich & Wanner 2006"


def _scheme_i(lam):
    """Substeps (c, mu, lambda) of Scheme I: Phi^lambda, stage weights mu = 1 - lambda and lambda."""
    return (1, 1 - lam, lam)


def _scheme_iii(lam, fractions=(Fraction(1),)):
    """Phi^lambda_{h/2} after Phi^(1 - lambda)_{h/2}, over each fraction of the step."""
    halves = ((HALF, lam, 1 - lam), (HALF, 1 - lam, lam))
    return tuple((times(f, c), mu, la) for f in fractions for c, mu, la in halves)


def _equip(signs, fractions=(Fraction(1),), alternative=()):
    """Rows (c, sign, group, alternative) of `equip`: each fraction is a group with its own root."""
    rows = []
    for g, f in enumerate(fractions):
        for a, list_of_signs in enumerate((signs, alternative)):
            rows += [(times(f, Fraction(1, len(list_of_signs))), s, g, a) for s in list_of_signs]
    return tuple(rows)


def _one_stage(id, name, substeps, source, **facts):
    facts = {"order": 1, "symmetric": False, "symplectic": True, "energy": BOUNDED, "quadratic": ROUND_OFF} | facts
    return Method(id=id, name=name, family="parametric", data=(1, substeps), source=source, **facts)


def _parameterised(id, name, source, make, **facts):
    """A method with a parameter lam = 1/3 at first, and what ``make(**parameters)`` derives from its parameters."""
    defaults = {"lam": Fraction(1, 3)} | facts.pop("parameters", {})
    common = {"family": "parametric", "symplectic": True, "energy": BOUNDED, "quadratic": ROUND_OFF}
    common |= {"symmetric": False, "requires": ("canonical",)} | facts
    return Method(
        id=id, name=name, source=source, parameters=defaults, with_parameters=make, **(common | make(**defaults))
    )


def _generating(order, lam):
    if not 1 <= order <= 6:
        raise InvalidInput(f"the generating function is derived for orders 1 to 6, not {order}")
    even = order + 1 if lam == HALF and order % 2 else order
    facts = {"data": (order, (_scheme_i(lam),)), "order": even, "symmetric": lam == HALF}
    return facts


def _scheme_iii_composed(scheme, order):
    return _parameterised(
        f"scheme-iii-{scheme}-{order}",
        f"Scheme III, {scheme.capitalize()} composition of order {order}",
        f"{TALK}, (21); " + ("Yoshida 1990" if scheme == "yoshida" else "Suzuki 1990"),
        lambda lam: {"data": (1, _scheme_iii(lam, SCHEMES[scheme](order)))},
        order=order,
        symmetric=True,
    )


def _equip_method(id, name, signs, source, fractions=(Fraction(1),), order=2, alternative=()):
    return Method(
        id=id,
        name=name,
        family="equip",
        data=_equip(signs, fractions, alternative),
        order=order,
        symmetric=True,
        symplectic=False,
        energy=ROUND_OFF,
        quadratic=ROUND_OFF,
        requires=("canonical",),
        source=source,
    )


_RK4 = ((0, 0, 0, 0), (HALF, 0, 0, 0), (0, HALF, 0, 0), (0, 0, 1, 0)) + (
    (Fraction(1, 6), Fraction(1, 3), Fraction(1, 3), Fraction(1, 6)),
)

METHODS: tuple[Method, ...] = (
    Method(
        "explicit-euler",
        "explicit Euler",
        "runge_kutta",
        1,
        False,
        False,
        DRIFT,
        DRIFT,
        "Euler 1768",
        data=((0,), (1,)),
    ),
    _one_stage(
        "implicit-euler",
        "implicit Euler",
        ((1, 1, 1),),
        f"{HLW}, I.1.2",
        symplectic=False,
        energy=DRIFT,
        quadratic=DRIFT,
    ),
    _one_stage(
        "symplectic-euler-p", "symplectic Euler, implicit in p", ((1, 0, 1),), f"de Vogelaere 1956; {HLW}, I.1.9"
    ),
    _one_stage(
        "symplectic-euler-q", "symplectic Euler, implicit in q", ((1, 1, 0),), f"de Vogelaere 1956; {HLW}, I.1.9"
    ),
    _one_stage(
        "implicit-midpoint", "implicit midpoint rule", ((1, HALF, HALF),), f"{HLW}, VI.3.4", order=2, symmetric=True
    ),
    _one_stage(
        "stormer-verlet",
        "Stormer-Verlet, kick-drift-kick",
        ((HALF, 0, 1), (HALF, 1, 0)),
        f"Verlet 1967; {HLW}, I.1.17",
        order=2,
        symmetric=True,
    ),
    _one_stage(
        "stormer-verlet-dkd",
        "Stormer-Verlet, drift-kick-drift",
        ((HALF, 1, 0), (HALF, 0, 1)),
        f"Verlet 1967; {HLW}, I.1.17",
        order=2,
        symmetric=True,
    ),
    Method(
        "rk4", "the classical Runge-Kutta method", "runge_kutta", 4, False, False, DRIFT, DRIFT, "Kutta 1901", data=_RK4
    ),
    _parameterised("scheme-i", "Scheme I", f"{TALK}, (19)", lambda lam: _generating(1, lam)),
    _parameterised("scheme-i-adjoint", "the adjoint of Scheme I", f"{TALK}, (10)", lambda lam: _generating(1, 1 - lam)),
    _parameterised("scheme-ii", "Scheme II", f"{TALK}, (20)", lambda lam: _generating(2, lam)),
    _parameterised(
        "generating-function",
        "generating function of order r",
        f"{TALK}, (18); Feng et al. 1989",
        lambda order, lam: _generating(order, lam),
        parameters={"order": 3},
    ),
    _parameterised(
        "scheme-iii",
        "Scheme III",
        f"{TALK}, (21)",
        lambda lam: {"data": (1, _scheme_iii(lam))},
        order=2,
        symmetric=True,
    ),
    *(_scheme_iii_composed(scheme, order) for scheme in ("yoshida", "suzuki") for order in (4, 6)),
    _equip_method("scheme-iv", "Scheme IV", (1,), f"{TALK}, (24)"),
    _equip_method("scheme-v", "Scheme V", (-1, 1), TALK),
    _equip_method(
        "scheme-iv-v", "Scheme IV, with Scheme V where it has no root", (1,), "phasebench", alternative=(-1, 1)
    ),
    _equip_method(
        "scheme-v-iv", "Scheme V, with Scheme IV where it has no root", (-1, 1), "phasebench", alternative=(1,)
    ),
    _equip_method(
        "scheme-iv-yoshida-4", "Scheme IV, triple jump", (1,), f"{TALK}; Yoshida 1990", SCHEMES["yoshida"](4), 4
    ),
    _equip_method(
        "scheme-v-yoshida-4", "Scheme V, triple jump", (-1, 1), f"{TALK}; Yoshida 1990", SCHEMES["yoshida"](4), 4
    ),
    _equip_method(
        "scheme-v-suzuki-4", "Scheme V, Suzuki's fractal", (-1, 1), f"{TALK}; Suzuki 1990", SCHEMES["suzuki"](4), 4
    ),
    Method(
        "avf",
        "averaged vector field",
        "averaged",
        2,
        True,
        False,
        ROUND_OFF,
        BOUNDED,
        "Quispel & McLaren 2008",
        data=((1,),),
        requires=("canonical",),
    ),
)

BY_ID = {m.id: m for m in METHODS}


def method(id: str | Method, **parameters) -> Method:
    """The method of that id, with values for its parameters: ``method("scheme-i", lam=-1)``.

    Raises
    ------
    InvalidInput
        For an unknown id (naming the nearest) or parameter, or a value that is no number.
    """
    if isinstance(id, Method):
        return id(**parameters) if parameters else id
    if id not in BY_ID:
        raise unknown("method", id, BY_ID)
    found = BY_ID[id]
    return found(**parameters) if parameters else found
