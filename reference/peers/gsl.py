"""Runge-Kutta steppers of GSL as peers: a C program with the problem's equations, compiled by the user's compiler.

GSL is reached by the headers and the library of the user's machine; the compiler's flags are
`native.FLAGS`.  Adaptive peers are GSL's driver with eps_abs = eps_rel = tol and a first step of 1e-6, as in its
example.  Fixed steps are gsl_odeiv2_evolve_apply_fixed_step with a control that never asks for another step, and
that asks the implicit steppers to iterate to `NEWTON`: with the usual controls a fixed step fails where its error
estimate exceeds the tolerance to which stages are solved.

rk2imp, rk4imp and rk4 estimate their error from two half steps, whose state they return: a step h is two of h / 2.

Source: M. Galassi et al., GNU Scientific Library Reference Manual, 2.7, Ordinary Differential Equations.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from phasebench.reference.files import entries, listed
from phasebench.reference.native import load_library

from .compiled import STEP_LIMIT, assignments, runs, with_macros
from .record import Claims, Peer

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

MANUAL = "https://www.gnu.org/software/gsl/doc/html/ode-initval.html, Stepping Functions"
#: Relative and absolute size of errors to which the implicit steppers are asked to solve their stages.
NEWTON = 1e-15
#: Default tolerance and first step, those of GSL's example.
TOLERANCE, FIRST_STEP = 1e-6, 1e-6
PROGRAM = listed(__file__)["program"]


def program(name: str, system: PartitionedSystem) -> str:
    """The C source of a program that runs the GSL stepper ``name`` on a system."""
    import sympy as sp

    places, variables = {"q": "x[{}]", "p": "x[D + {}]"}, (("q", system.q), ("p", system.p))
    slope = [sp.sympify(e) for e in (*system.dq, *system.dp)]
    of_state = [sp.diff(e, x) for e in slope for x in (*system.q, *system.p)] if name.endswith("imp") else []
    return with_macros(
        PROGRAM,
        SIZE=system.d,
        STEPPER=f"gsl_odeiv2_step_{name}",
        FIELD=assignments(places, slope, *variables),
        JACOBIAN=assignments(places, of_state, *variables),
        NEWTON=NEWTON,
        FIRST=FIRST_STEP,
        LIMIT=STEP_LIMIT,
    )


def _peer(name: str, order: int, about: str, source: str, adaptive: bool = False) -> Peer:
    how = "tol is eps_abs = eps_rel of the driver, 1e-6 in GSL's example" if adaptive else "fixed steps"
    return Peer(
        f"gsl-{name}{'-adaptive' if adaptive else ''}",
        f"GSL's {name}{', adaptive' if adaptive else ''}",
        package="gsl",
        adaptive=adaptive,
        order=order,
        license="GPL-3.0",
        about=f"{about}; {how}; compiled C with the problem's equations inside, by the flags of the bare C loop",
        source=source,
        claims=Claims(order=order, source=f"{MANUAL}: gsl_odeiv2_step_{name}"),
        load=load_library,
        tol=TOLERANCE if adaptive else None,
        least=1e-14,
        rows_end_steps=adaptive,
        **runs(partial(program, name), "C", adaptive, ("gsl", "gslcblas")),
    )


PEERS: tuple[Peer, ...] = (
    *(_peer(**entry) for entry in entries(__file__)),
    *(_peer(**entry, adaptive=True) for entry in entries(__file__) if entry["name"] != "rk4"),
)
