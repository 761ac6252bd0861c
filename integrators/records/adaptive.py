"""Methods of variable steps: reversible in a fictitious time, over the kernel of `adaptive`."""

from __future__ import annotations

from phasebench.integrators.record import BOUNDED, ROUND_OFF, Method

from . import classical, compositions

SOURCE = "Hairer & Soderlind 2005; Hairer, Lubich & Wanner 2006, VIII.3.2; dt = h (sum r^-3)^(-1/2)"


def adaptive(id, name, order, source, cite, data=(), requires=("canonical", "singular distances")):
    """A method whose step follows the distances to the singularities; h is the step where the distance is 1."""
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
    """The method of variable steps over a symmetric splitting, a record of the family "parametric"."""
    requires = ("canonical", "separable", "quadratic kinetic energy", "singular distances")
    cite = tuple(dict.fromkeys((*base.cite, "hairer2005", "hairer2006")))
    return adaptive(id, name, base.order, f"{base.source}; {SOURCE}", cite, base.data, requires)


VERLET, DRIFTING = (next(m for m in classical.METHODS if m.id == id) for id in ("stormer-verlet", "stormer-verlet-dkd"))

METHODS: tuple[Method, ...] = (
    split(VERLET, "stormer-verlet-adaptive", "Stormer-Verlet"),
    split(
        compositions.composed(DRIFTING, "sofroniou-spaletta-10"),
        "sofroniou-spaletta-10-adaptive",
        "Stormer-Verlet, composed by sofroniou-spaletta-10,",
    ),
    *(
        adaptive(
            f"gauss-{s}-adaptive",
            f"Gauss, {s} stages,",
            2 * s,
            f"Butcher 1964; {SOURCE}",
            ("butcher1964", "hairer2005", "hairer2006"),
            (s,),
        )
        for s in (4, 6, 8)
    ),
)
