"""The steppers of Boost.odeint as peers: a C++ program with the problem's equations, compiled by the user's compiler.

The state is std::array, whose size the compiler knows; the compiler's flags are `native.FLAGS`.  Fixed
steps are ``integrate_n_steps``; a controlled stepper is ``make_controlled(tol, tol, stepper)`` in ``integrate_times``,
whose first step is 0.01, that of the documentation's examples, or the spacing of rows where that is less.

The symplectic steppers take q' = f(p) and p' = g(q).  The header of sb3a_m4_mclachlan does not include its base class:
the program, which is in the TOML file beside this module, does.

Source: K. Ahnert, M. Mulansky, AIP Conf. Proc. 1389 (2011) 1586-1589.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from phasebench.reference.files import entries, listed
from phasebench.reference.native import load_library

from .compiled import STEP_LIMIT, assignments, runs, with_macros
from .record import Claims, Peer, split_alone

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

TABLE = (
    "https://www.boost.org/doc/libs/1_74_0/libs/numeric/odeint/doc/html/boost_numeric_odeint/odeint_in_detail/"
    "steppers.html, table Stepper Algorithms, and order_value of the header"
)
#: Default tolerance, that of the documentation's examples.
TOLERANCE = 1e-6
SYMPLECTIC, CONTROLLED = "symplectic", "controlled"
PROGRAM = listed(__file__)["program"]


def program(header: str, kind: str, system: PartitionedSystem) -> str:
    """The C++ source of a program that runs a stepper of Boost.odeint on a system.

    ``header`` is the stepper's name, which its header has too; ``kind`` is SYMPLECTIC, CONTROLLED or "fixed".
    """
    q, p = ("q", system.q), ("p", system.p)
    if kind == SYMPLECTIC:
        equations = {
            "VELOCITY": assignments({"p": "p[{}]"}, system.dq, p),
            "FORCE": assignments({"q": "q[{}]"}, system.dp, q),
        }
    else:
        equations = {"FIELD": assignments({"q": "x[{}]", "p": "x[D + {}]"}, [*system.dq, *system.dp], q, p)}
    stepper = f"{header}<{'half' if kind == SYMPLECTIC else 'whole'}>"
    macros = {"SIZE": system.d, "HEADER": f"<boost/numeric/odeint/stepper/{header}.hpp>", "STEPPER": stepper}
    if kind == CONTROLLED:
        own = header == "bulirsch_stoer"
        macros["CONTROLLED"] = "PEER_STEPPER(tol, tol)" if own else "make_controlled(tol, tol, PEER_STEPPER())"
    return with_macros(PROGRAM, **macros, **equations, LIMIT=STEP_LIMIT)


def _peer(id: str, header: str, kind: str, name: str, about: str, source: str, order: int | None = None) -> Peer:
    adaptive, split = kind == CONTROLLED, kind == SYMPLECTIC
    why = "its system is a pair of functions, q' = f(p) and p' = g(q): H must be T(p) + V(q)"
    return Peer(
        f"boost-{id}",
        f"Boost.odeint's {name}",
        package="boost",
        adaptive=adaptive,
        order=order,
        license="BSL-1.0",
        about=f"{about}; compiled C++ with the problem's equations inside, by the flags of the bare C loop",
        source=source,
        claims=Claims(order=order, symplectic=True if split else None, source=TABLE),
        load=load_library,
        tol=TOLERANCE if adaptive else None,
        least=1e-15,
        rows_end_steps=adaptive,
        **runs(partial(program, header, kind), "C++", adaptive),
        **(split_alone(why) if split else {}),
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
