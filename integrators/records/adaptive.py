"""Records of methods with variable steps: reversible ones (family `adaptive`), and field-controlled ones (`field`).

The steps of the former follow the distances to singularities of H, those of the latter the derivatives of the vector
field along the orbit.
"""

from __future__ import annotations

from typing import Any

from phasebench.integrators.record import DRIFTING, ROUND_OFF, SYMPLECTIC, Method

from . import classical, compositions

SOURCE = "Hairer & Soderlind 2005; Hairer, Lubich & Wanner 2006, VIII.3.2; dt = h (sum r^-3)^(-1/2)"


def adaptive(*, name: str, source: str, cite: tuple[str, ...], **facts: Any) -> Method:
    """Make the record of a method whose step depends on the distance to singularities: h is the step at distance 1.

    Its data are the pair (1, substeps) for a splitting, where 1 stands for one stage and the substeps are those of
    `classical.one_stage`, or (s,) for Gauss's method of s stages.  In fictitious time it is symmetric and symplectic.
    """
    common = SYMPLECTIC | {"symmetric": False, "symplectic": False}
    return Method(
        name=f"{name} with a reversible control of the step; h is the step where the distance to the singularity is 1",
        family="adaptive",
        source=f"{source}; {SOURCE}",
        cite=tuple(dict.fromkeys((*cite, "hairer2005", "hairer2006"))),
        **common,
        **facts,
    )


def split(base: Method, id: str, name: str) -> Method:
    """Make the variable-step version, see `adaptive`, of a symmetric splitting ``base`` of the family "parametric"."""
    return adaptive(
        id=id,
        name=name,
        order=base.order,
        source=base.source,
        cite=base.cite,
        data=lambda: base.data,
        requires=("canonical", "separable", "quadratic kinetic energy", "constant mass matrix", "singular distances"),
    )


METHODS: tuple[Method, ...] = (
    split(classical.BY_ID["stormer-verlet"], "stormer-verlet-adaptive", "Stormer-Verlet"),
    split(
        compositions.compose(classical.BY_ID["stormer-verlet-dkd"], "sofroniou-spaletta-10"),
        "sofroniou-spaletta-10-adaptive",
        "Stormer-Verlet, composed by sofroniou-spaletta-10,",
    ),
    *(
        adaptive(
            id=f"gauss-{s}-adaptive",
            name=f"Gauss, {s} stages,",
            order=2 * s,
            source="Butcher 1964",
            cite=("butcher1964",),
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
            source="Butcher 1964; Aarseth 1985 (the quotient of derivatives); Rein & Spiegel 2015 (rejection)",
            cite=("butcher1964", "aarseth1985", "rein-spiegel2015"),
            requires=("canonical", "elementary derivatives"),
            data=(s,),
            **(DRIFTING | {"quadratic": ROUND_OFF}),
        )
        for s in (4, 6, 8)
    ),
)
