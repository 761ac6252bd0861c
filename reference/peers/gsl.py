r"""Runge-Kutta steppers of GSL as peers: a C program with the problem's equations, compiled by the user's compiler.

GSL is reached by the headers and the library of the user's machine; the compiler's flags are
`native.FLAGS`.  Adaptive peers are GSL's driver with eps_abs = eps_rel = tol and a first step of 1e-6, as in its
example.  Fixed steps are gsl_odeiv2_evolve_apply_fixed_step with a control that never asks for another step, and
that asks the implicit steppers to iterate to `NEWTON`: with the usual controls a fixed step fails where its error
estimate exceeds the tolerance to which stages are solved.

rk2imp, rk4imp and rk4 estimate their error from two half steps, whose state they return: a step h is two of h / 2.

Source: M. Galassi et al., GNU Scientific Library Reference Manual, 2.7, Ordinary Differential Equations.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from phasebench.reference.native import load_library, load_source, statements

from .boost import KEPT, STEP_LIMIT, runs
from .record import Claims, Peer

if TYPE_CHECKING:
    import ctypes

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

MANUAL = "https://www.gnu.org/software/gsl/doc/html/ode-initval.html, Stepping Functions"
#: Relative and absolute size of errors to which the implicit steppers are asked to solve their stages.
NEWTON = 1e-15
#: Default tolerance and first step, those of GSL's example.
TOLERANCE, FIRST_STEP = 1e-6, 1e-6

PROGRAM = """
#include <math.h>
#include <string.h>
#include <gsl/gsl_errno.h>
#include <gsl/gsl_matrix.h>
#include <gsl/gsl_odeiv2.h>
#define D {d}
static long evaluations;
static int field(double t, const double x[], double slope[], void *none) {{
  evaluations++; {field} return GSL_SUCCESS;
}}
static int jacobian(double t, const double x[], double *slope, double of_t[], void *none) {{
  {jacobian} for (int i = 0; i < 2 * D; i++) of_t[i] = 0; return GSL_SUCCESS;
}}
static void *no_control(void) {{ static int none; return &none; }}
static int init(void *s, double a, double r, double y, double dy) {{ return GSL_SUCCESS; }}
static int adjust(void *s, size_t n, unsigned o, const double y[], const double e[], const double dy[], double *h) {{
  return GSL_ODEIV_HADJ_NIL;
}}
static int level(void *s, const double y, const double dy, const double h, const size_t i, double *allowed) {{
  *allowed = {newton} * (1 + fabs(y)); return GSL_SUCCESS;
}}
static int set(void *s, const gsl_odeiv2_driver *d) {{ return GSL_SUCCESS; }}
static void release(void *s) {{ }}
static const gsl_odeiv2_control_type FIXED = {{ "fixed", no_control, init, adjust, level, set, release }};
int steps(double *y, double h, long n, long *counts) {{
  gsl_odeiv2_system system = {{ field, jacobian, 2 * D, 0 }};
  gsl_set_error_handler_off();
  evaluations = 0;
  gsl_odeiv2_driver *d = gsl_odeiv2_driver_alloc_y_new(&system, gsl_odeiv2_step_{name}, h, 1e-6, 1e-6);
  gsl_odeiv2_control *usual = d->c;
  d->c = gsl_odeiv2_control_alloc(&FIXED);
  double t = 0;
  int code = GSL_SUCCESS;
  long taken = 0;
  for (; taken < n && code == GSL_SUCCESS; taken++)
    code = gsl_odeiv2_evolve_apply_fixed_step(d->e, d->c, d->s, &system, &t, h, y);
  counts[0] = taken; counts[1] = evaluations;
  gsl_odeiv2_control_free(d->c);
  d->c = usual;
  gsl_odeiv2_driver_free(d);
  return code;
}}
int times(double *y, const double *t, long n, double h, double tol, double *rows, long *counts) {{
  gsl_odeiv2_system system = {{ field, jacobian, 2 * D, 0 }};
  gsl_set_error_handler_off();
  evaluations = 0;
  h = h < 0 ? -{first} : {first};
  gsl_odeiv2_driver *d = gsl_odeiv2_driver_alloc_y_new(&system, gsl_odeiv2_step_{name}, h, tol, tol);
  gsl_odeiv2_driver_set_nmax(d, {limit});
  double now = t[0];
  int code = GSL_SUCCESS;
  long row = 1, taken = 0;
  memcpy(rows, y, 2 * D * sizeof(double));
  for (; row < n; row++) {{
    code = gsl_odeiv2_driver_apply(d, &now, t[row], y);
    taken += d->n;
    if (code != GSL_SUCCESS) break;
    memcpy(rows + 2 * D * row, y, 2 * D * sizeof(double));
  }}
  counts[0] = taken; counts[1] = evaluations; counts[2] = row;
  gsl_odeiv2_driver_free(d);
  return code;
}}
"""


def source(system: PartitionedSystem, name: str) -> str:
    """The C source of a program that runs the GSL stepper ``name`` on a system."""
    import sympy as sp

    d = system.d
    arguments = [("q", system.q), ("p", system.p)]
    read = " ".join(f"const double {a}_{i} = x[{i + k * d}];" for k, a in enumerate("qp") for i in range(d))
    slope = [sp.sympify(e) for e in (*system.dq, *system.dp)]
    of_state = [sp.diff(e, x) for e in slope for x in (*system.q, *system.p)] if name.endswith("imp") else []
    bodies = []
    for expressions in (slope, of_state):
        before, values = statements(expressions, *arguments) if expressions else ("", [])
        bodies.append(" ".join([read, before, *(f"slope[{i}] = {value};" for i, value in enumerate(values))]))
    return PROGRAM.format(
        d=d, field=bodies[0], jacobian=bodies[1], name=name, newton=NEWTON, first=FIRST_STEP, limit=STEP_LIMIT
    )


@lru_cache(maxsize=KEPT)
def _program(system: PartitionedSystem, name: str) -> ctypes.CDLL:
    """The compiled program, loaded, that runs the GSL stepper ``name`` on a system."""
    return load_source(source(system, name), "C", ("gsl", "gslcblas"))


def _peer(name: str, order: int, about: str, source: str, adaptive: bool = False) -> Peer:
    tol = TOLERANCE if adaptive else None
    run, prepare = runs(lambda system: getattr(_program(system, name), "times" if adaptive else "steps"), adaptive, tol)
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
        run=run,
        prepare=prepare,
        claims=Claims(order=order, source=f"{MANUAL}: gsl_odeiv2_step_{name}"),
        load=load_library,
        tol=tol,
        least=1e-14,
        rows_end_steps=adaptive,
    )


STEPPERS = (
    ("rk2imp", 2, "implicit midpoint rule, two halves of a step, with GSL's Newton", "Hairer & Wanner 1996, IV.8"),
    ("rk4imp", 4, "Gauss of two stages, two halves of a step, with GSL's Newton", "Hairer & Wanner 1996, IV.8"),
    ("rk4", 4, "the classical method, two halves of a step", "Kutta 1901, Z. Math. Phys. 46, 435-453"),
    ("rk8pd", 8, "explicit, of thirteen stages", "Prince & Dormand 1981, J. Comput. Appl. Math. 7, 67-75"),
)
PEERS: tuple[Peer, ...] = (
    *(_peer(*stepper) for stepper in STEPPERS),
    *(_peer(*stepper, adaptive=True) for stepper in STEPPERS if stepper[0] != "rk4"),
)
