"""Records of methods for a rigid body in quaternions: splittings, Moser-Veselov, a midpoint rule, compositions."""

from __future__ import annotations

from phasebench.integrators.record import BOUNDED, SYMPLECTIC, Method

from .compositions import compose


def rigid(id: str, name: str, scheme: str, source: str, cite: tuple[str, ...], *, symplectic: bool = True) -> Method:
    """Make the record of a symmetric method of order 2 for a rigid body: half a kick, a free motion, half a kick.

    The kicks are those of the body's potential; ``scheme`` is the rule for the free body: "axes" (turns about the
    body's axes 3, 2, 1, 2, 3), "top" (the flow of a symmetric top between turns about an axis), "moser-veselov" (their
    discrete equations) or "midpoint" (the midpoint rule for the angular momentum).
    """
    return Method(
        id=id,
        name=f"rigid body: {name}",
        family="rigid",
        order=2,
        source=source,
        cite=cite,
        requires=("rigid body",),
        data=(scheme, (1,)),
        **(SYMPLECTIC | {"symplectic": symplectic, "quadratic": BOUNDED}),
    )


DLM = rigid(
    "rigid-dlm",
    "turns about the axes 3, 2, 1, 2, 3",
    "axes",
    "Dullweber, Leimkuhler & McLachlan 1997; Miller et al. 2002 in quaternions",
    ("dullweber1997", "miller2002"),
)
REICH = rigid(
    "rigid-reich",
    "a symmetric top between turns about the axis that is left",
    "top",
    "Reich 1994; Touma & Wisdom 1994",
    ("reich1994", "touma-wisdom1994"),
)

METHODS: tuple[Method, ...] = (
    DLM,
    REICH,
    rigid(
        "moser-veselov",
        "the discrete equations of Moser and Veselov, kicks by the potential around them",
        "moser-veselov",
        "Moser & Veselov 1991; Hairer & Vilmart 2006 in quaternions",
        ("moser-veselov1991", "hairer-vilmart2006"),
    ),
    rigid(
        "lie-midpoint",
        "the midpoint rule for the momentum, and its Cayley transform for the attitude",
        "midpoint",
        "Austin, Krishnaprasad & Wang 1993",
        ("austin1993",),
        symplectic=False,
    ),
    compose(DLM, "suzuki-4"),
    compose(REICH, "suzuki-4"),
    compose(REICH, "kahan-li-6"),
)
