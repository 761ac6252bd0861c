"""Averaged vector fields and discrete gradients."""

from __future__ import annotations

from fractions import Fraction

from phasebench.integrators.coefficients.fractions import suzuki, times, triple_jump
from phasebench.integrators.record import BOUNDED, NONE, ROUND_OFF, Method

HALF = Fraction(1, 2)
GONZALEZ = "Gonzalez 1996"
AVF, PAVF, ITOH_ABE = "Quispel & McLaren 2008", "Cai, Li & Wang 2018", "Itoh & Abe 1988, section 3"
WHOLE, PARTITIONED, COMPONENTS = "whole", "momenta, coordinates", "components"
#: The path, its reverse, the mean of both.
FORTH, BACK, MEAN = 1, -1, 0


def conserving(id, name, source, cite, data, **facts):
    """A method that keeps H for every canonical system."""
    facts = {"order": 2, "symmetric": True, "quadratic": BOUNDED} | facts
    common = {"symplectic": False, "energy": ROUND_OFF, "requires": ("canonical",)}
    return Method(id=id, name=name, source=source, cite=cite, data=tuple(data), **common, **facts)


def averaged(*description, **facts):
    """A method of substeps (fraction, path, direction) of the family `averaged`."""
    return conserving(*description, family="averaged", **facts)


def gonzalez(*description, **facts):
    """A composition of Gonzalez' discrete gradient method over fractions of the step."""
    return conserving(*description, family="discrete_gradient", **facts)


def there_and_back(path, fractions=(Fraction(1),)):
    """The path's map and its adjoint over the halves of each fraction of the step."""
    return [(times(f, HALF), path, direction) for f in fractions for direction in (FORTH, BACK)]


METHODS: tuple[Method, ...] = (
    averaged("avf", "averaged vector field", AVF, ("quispel2008",), [(1, WHOLE, FORTH)]),
    averaged(
        "avf-yoshida-4",
        "averaged vector field, Yoshida composition of order 4",
        f"{AVF}; Yoshida 1990",
        ("quispel2008", "yoshida1990"),
        [(f, WHOLE, FORTH) for f in triple_jump(4)],
        order=4,
    ),
    averaged(
        "avf-suzuki-4",
        "averaged vector field, Suzuki composition of order 4",
        f"{AVF}; Suzuki 1990",
        ("quispel2008", "suzuki1990"),
        [(f, WHOLE, FORTH) for f in suzuki(4)],
        order=4,
    ),
    averaged(
        "pavf",
        "partitioned averaged vector field, momenta first",
        PAVF,
        ("cai2018",),
        [(1, PARTITIONED, FORTH)],
        order=1,
        symmetric=False,
    ),
    averaged(
        "pavf-adjoint",
        "partitioned averaged vector field, coordinates first",
        PAVF,
        ("cai2018",),
        [(1, PARTITIONED, BACK)],
        order=1,
        symmetric=False,
    ),
    averaged(
        "pavf-c",
        "partitioned averaged vector field, composition with its adjoint",
        PAVF,
        ("cai2018",),
        there_and_back(PARTITIONED),
    ),
    averaged(
        "pavf-p",
        "partitioned averaged vector field, mean with its adjoint",
        PAVF,
        ("cai2018",),
        [(1, PARTITIONED, MEAN)],
    ),
    averaged(
        "pavf-c-yoshida-4",
        "partitioned averaged vector field, Yoshida composition of order 4",
        f"{PAVF}; Yoshida 1990",
        ("cai2018", "yoshida1990"),
        there_and_back(PARTITIONED, triple_jump(4)),
        order=4,
    ),
    averaged(
        "itoh-abe",
        "Itoh-Abe discrete gradient",
        ITOH_ABE,
        ("itoh1988",),
        [(1, COMPONENTS, FORTH)],
        order=1,
        symmetric=False,
        quadratic=NONE,  # it promises none; on perturbed Kepler L oscillates without a drift
    ),
    averaged(
        "itoh-abe-symmetrized",
        "Itoh-Abe discrete gradient, mean with the reverse path",
        ITOH_ABE,
        ("itoh1988",),
        [(1, COMPONENTS, MEAN)],
    ),
    averaged(
        "itoh-abe-c",
        "Itoh-Abe discrete gradient, composition with its adjoint",
        ITOH_ABE,
        ("itoh1988",),
        there_and_back(COMPONENTS),
    ),
    gonzalez("gonzalez", "Gonzalez' midpoint discrete gradient", GONZALEZ, ("gonzalez1996",), (1,)),
    gonzalez(
        "gonzalez-yoshida-4",
        "Gonzalez' discrete gradient, Yoshida composition of order 4",
        f"{GONZALEZ}; Yoshida 1990",
        ("gonzalez1996", "yoshida1990"),
        triple_jump(4),
        order=4,
    ),
)
