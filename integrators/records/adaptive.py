"""Records of methods with variable steps: reversible ones (family `adaptive`), and field-controlled ones (`field`).

The steps of the former follow the distances to singularities of H, those of the latter the derivatives of the vector
field along the orbit.
"""

from __future__ import annotations

from typing import Any

from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF, Method

from . import classical, compositions

SOURCE = "Hairer & Soderlind 2005; Hairer, Lubich & Wanner 2006, VIII.3.2; dt = h (sum r^-3)^(-1/2)"


def adaptive(
    *,
    id: str,
    name: str,
    order: int,
    source: str,
    cite: tuple[str, ...],
    requires: tuple[str, ...],
    data: tuple[Any, ...] = (),
) -> Method:
    """Make the record of a method whose step depends on the distance to singularities: h is the step at distance 1.

    ``data`` are the coefficients: the pair (1, substeps) for a splitting, where 1 stands for one stage and the substeps
    are those of `classical.one_stage`, or (s,) for Gauss's method of s stages.  The other arguments are fields of the
    record.
    """
    return Method(
        id=id,
        name=f"{name} with a reversible control of the step; h is the step where the distance to the singularity is 1",
        family="adaptive",
        order=order,
        symmetric=False,  # in time: in fictitious time it is
        symplectic=False,
        energy=BOUNDED,
        quadratic=ROUND_OFF,
        source=source,
        cite=cite,
        requires=requires,
        data=data,
    )


def split(base: Method, id: str, name: str) -> Method:
    """Make the variable-step version, see `adaptive`, of a symmetric splitting ``base`` of the family "parametric"."""
    requires = ("canonical", "separable", "quadratic kinetic energy", "singular distances")
    cite = tuple(dict.fromkeys((*base.cite, "hairer2005", "hairer2006")))
    return adaptive(
        id=id,
        name=name,
        order=base.order,
        source=f"{base.source}; {SOURCE}",
        cite=cite,
        data=base.data,
        requires=requires,
    )


VERLET, DRIFTING = (next(m for m in classical.METHODS if m.id == id) for id in ("stormer-verlet", "stormer-verlet-dkd"))

METHODS: tuple[Method, ...] = (
    split(VERLET, "stormer-verlet-adaptive", "Stormer-Verlet"),
    split(
        compositions.compose(DRIFTING, "sofroniou-spaletta-10"),
        "sofroniou-spaletta-10-adaptive",
        "Stormer-Verlet, composed by sofroniou-spaletta-10,",
    ),
    *(
        adaptive(
            id=f"gauss-{s}-adaptive",
            name=f"Gauss, {s} stages,",
            order=2 * s,
            source=f"Butcher 1964; {SOURCE}",
            cite=("butcher1964", "hairer2005", "hairer2006"),
            requires=("canonical", "singular distances", "elementary derivatives"),
            data=(s,),
        )
        for s in (4, 6, 8)
    ),
    *(
        Method(
            id=f"gauss-{s}-field",
            name=f"Gauss, {s} stages, with steps by the field; h is the step where it changes as at the start",
            family="field",
            order=2 * s,
            symmetric=False,
            symplectic=False,
            energy=DRIFT,
            quadratic=ROUND_OFF,
            source="Butcher 1964; Aarseth 1985 (the quotient of derivatives); Rein & Spiegel 2015 (rejection)",
            cite=("butcher1964", "aarseth1985", "rein-spiegel2015"),
            requires=("canonical", "elementary derivatives"),
            data=(s,),
        )
        for s in (4, 6, 8)
    ),
)
