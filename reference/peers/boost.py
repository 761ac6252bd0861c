r"""The steppers of Boost.odeint as peers: a C++ program with the problem's equations, compiled by the user's compiler.

The state is std::array, whose size the compiler knows; the compiler's flags are `native.FLAGS`.  Fixed
steps are ``integrate_n_steps``; a controlled stepper is ``make_controlled(tol, tol, stepper)`` in ``integrate_times``,
whose first step is 0.01, that of the documentation's examples, or the spacing of rows where that is less.

The symplectic steppers take q' = f(p) and p' = g(q).  The header of sb3a_m4_mclachlan does not include its base class:
the program does.

Source: K. Ahnert, M. Mulansky, AIP Conf. Proc. 1389 (2011) 1586-1589.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries
from phasebench.reference.native import load_library, load_source, statements

from .record import NOT_FINITE, Claims, Peer, Run, Start, Task, split_alone

if TYPE_CHECKING:
    import sympy as sp

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

    from .prepared import Calls

TABLE = (
    "https://www.boost.org/doc/libs/1_74_0/libs/numeric/odeint/doc/html/boost_numeric_odeint/odeint_in_detail/"
    "steppers.html, table Stepper Algorithms, and order_value of the header"
)
#: Default tolerance, that of the documentation's examples, and the largest number of steps between two rows.
TOLERANCE, STEP_LIMIT = 1e-6, 10_000_000
FIRST_STEP = 0.01
#: Size of the cache of compiled programs.
KEPT = 128
SYMPLECTIC, FIXED, CONTROLLED = "symplectic", "fixed", "controlled"

PROGRAM = """
#include <array>
#include <cmath>
#include <utility>
#include <vector>
#include <boost/numeric/odeint/stepper/base/symplectic_rkn_stepper_base.hpp>
#include <boost/numeric/odeint/algebra/range_algebra.hpp>
#include <boost/numeric/odeint/algebra/default_operations.hpp>
#include <boost/numeric/odeint/algebra/algebra_dispatcher.hpp>
#include <boost/numeric/odeint/algebra/operations_dispatcher.hpp>
#include <boost/numeric/odeint/util/resizer.hpp>
#include <boost/numeric/odeint/stepper/{header}.hpp>
#include <boost/numeric/odeint/stepper/generation.hpp>
#include <boost/numeric/odeint/integrate/integrate_n_steps.hpp>
#include <boost/numeric/odeint/integrate/integrate_times.hpp>
#include <boost/numeric/odeint/integrate/max_step_checker.hpp>
using namespace boost::numeric::odeint;
using std::sqrt; using std::sin; using std::cos; using std::tan; using std::exp; using std::log; using std::pow;
using std::sinh; using std::cosh; using std::tanh; using std::abs; using std::fabs; using std::atan2;
using std::asin; using std::acos; using std::atan;
const std::size_t D = {d};
typedef std::array<double, D> half;
typedef std::array<double, 2 * D> whole;
static long evaluations;
{equations}
"""
ONE = """
struct field {{ void operator()(const whole &x, whole &slope, double) const {{ evaluations++; {body} }} }};
typedef whole state;
static state load(const double *y) {{ state x; for (std::size_t i = 0; i < 2 * D; i++) x[i] = y[i]; return x; }}
static void store(const state &x, double *y) {{ for (std::size_t i = 0; i < 2 * D; i++) y[i] = x[i]; }}
static field equations() {{ return field(); }}
"""
TWO = """
struct velocity {{ void operator()(const half &p, half &slope) const {{ {of_q} }} }};
struct force {{ void operator()(const half &q, half &slope) const {{ evaluations++; {of_p} }} }};
typedef std::pair<half, half> state;
static state load(const double *y) {{
  state x; for (std::size_t i = 0; i < D; i++) {{ x.first[i] = y[i]; x.second[i] = y[D + i]; }} return x;
}}
static void store(const state &x, double *y) {{
  for (std::size_t i = 0; i < D; i++) {{ y[i] = x.first[i]; y[D + i] = x.second[i]; }}
}}
static std::pair<velocity, force> equations() {{ return std::make_pair(velocity(), force()); }}
"""
STEPS = """
extern "C" int steps(double *y, double h, long n, long *counts) {{
  evaluations = 0;
  {stepper} stepper;
  state x = load(y);
  integrate_n_steps(stepper, equations(), x, 0.0, h, n);
  store(x, y);
  counts[0] = n; counts[1] = evaluations;
  return 0;
}}
"""
TIMES = """
extern "C" int times(double *y, const double *t, long n, double h, double tol, double *rows, long *counts) {{
  evaluations = 0;
  state x = load(y);
  long row = 0;
  int failed = 0;
  std::vector<double> at(t, t + n);
  auto save = [&](const state &x, double) {{ store(x, rows + 2 * D * row); row++; }};
  try {{
    counts[0] = integrate_times({make}, equations(), x, at.begin(), at.end(), h, save, max_step_checker({limit}));
  }} catch (const std::exception &) {{ failed = 1; }}
  store(x, y);
  counts[1] = evaluations; counts[2] = row;
  return failed;
}}
"""


def _body(
    variables: Sequence[tuple[str, str]],
    expressions: Sequence[sp.Expr],
    arguments: Sequence[tuple[str, Sequence[sp.Symbol]]],
) -> str:
    """Write C++ statements that define ``variables``, pairs (name, C++ expression), and set slope[i] to expression i.

    ``arguments`` are the pairs (letter, SymPy variables) of `native.statements`.
    """
    before, values = statements(expressions, *arguments)
    read = " ".join(f"const double {name} = {place};" for name, place in variables)
    return " ".join([read, before, *(f"slope[{i}] = {value};" for i, value in enumerate(values))])


def source(system: PartitionedSystem, header: str, kind: str) -> str:
    """The C++ source of a program that runs a stepper of Boost.odeint on a system.

    ``header`` is the stepper's name, which its header has too; ``kind`` is SYMPLECTIC, FIXED or CONTROLLED.
    """
    d = system.d
    if kind == SYMPLECTIC:
        of_q = _body([(f"p_{i}", f"p[{i}]") for i in range(d)], system.dq, [("p", system.p)])
        of_p = _body([(f"q_{i}", f"q[{i}]") for i in range(d)], system.dp, [("q", system.q)])
        equations, state = TWO.format(of_q=of_q, of_p=of_p), "half"
    else:
        read = [(f"{name}_{i}", f"x[{i + k * d}]") for k, name in enumerate("qp") for i in range(d)]
        body = _body(read, [*system.dq, *system.dp], [("q", system.q), ("p", system.p)])
        equations, state = ONE.format(body=body), "whole"
    stepper = f"{header}<{state}>"
    if kind == CONTROLLED:
        own = header == "bulirsch_stoer"
        make = f"{stepper}(tol, tol)" if own else f"make_controlled(tol, tol, {stepper}())"
        run = TIMES.format(make=make, limit=STEP_LIMIT)
    else:
        run = STEPS.format(stepper=stepper)
    return PROGRAM.format(header=header, d=d, equations=equations) + run


@lru_cache(maxsize=KEPT)
def _program(system: PartitionedSystem, header: str, kind: str) -> Any:
    """The compiled C function that runs a stepper (see `source`) on a system."""
    library = load_source(source(system, header, kind), "C++")
    return library.times if kind == CONTROLLED else library.steps


def _fixed(run_steps: Callable[..., int], task: Task) -> Run:
    """Run a task at fixed steps by a compiled function.

    ``run_steps(y, h, n, counts)`` takes n steps of h from the state y; it overwrites y with the new state and
    ``counts`` with the numbers of steps and of evaluations, and returns 0 or an error code.
    """
    y, counts, numbers = task.state, np.zeros(3, dtype=np.int64), task.numbers
    rows, total, seconds, failure = [y.copy()], np.zeros(3, dtype=np.int64), 0.0, None
    for before, number in pairwise(numbers):
        started = time.perf_counter()
        code = run_steps(y, task.h, number - before, counts)
        seconds += time.perf_counter() - started
        total += counts
        if code or not np.isfinite(y).all():
            failure = f"it returned {code}" if code else NOT_FINITE
            break
        rows.append(y.copy())
    return Run.of_states(np.array(rows), int(total[0]), int(total[1]), seconds, failure)


def _adaptive(run_times: Callable[..., int], task: Task) -> Run:
    """Run a task at adaptive steps by a compiled function.

    ``run_times(y, times, first step, tol, rows, counts)`` fills ``rows`` with the states at the times, and ``counts``
    with the numbers of steps, of evaluations and of rows reached; it returns 0, or an error code.
    """
    y, counts, times = task.state, np.zeros(3, dtype=np.int64), np.array(task.times)
    rows = np.zeros((len(times), len(y)))
    first = np.copysign(min(FIRST_STEP, abs(task.h)), task.h)
    started = time.perf_counter()
    code = run_times(y, times, first, task.tol, rows, counts)
    seconds = time.perf_counter() - started
    rows = rows[: max(int(counts[2]), 1)]
    rows[0] = task.state
    failure = f"it returned {code}: no step met the tolerance" if code else None
    return Run.of_states(rows, int(counts[0]), int(counts[1]), seconds, failure)


STEPS_TYPES = [ctypes.c_void_p, ctypes.c_double, ctypes.c_long, ctypes.c_void_p]
TIMES_TYPES = [*[ctypes.c_void_p] * 2, ctypes.c_long, *[ctypes.c_double] * 2, *[ctypes.c_void_p] * 2]


def on_arrays(function: Any, adaptive: bool) -> Callable[..., int]:
    """Wrap a compiled function, which takes addresses, as one that takes NumPy arrays.

    The result is the ``run_times`` of `_adaptive` if ``adaptive``, else the ``run_steps`` of `_fixed`.
    """
    function.argtypes = TIMES_TYPES if adaptive else STEPS_TYPES
    function.restype = ctypes.c_int
    if not adaptive:
        return lambda y, h, n, counts: function(y.ctypes.data, h, n, counts.ctypes.data)

    def run(y: np.ndarray, times: np.ndarray, first: float, tol: float, rows: np.ndarray, counts: np.ndarray) -> int:
        pointers = rows.ctypes.data, counts.ctypes.data
        return function(y.ctypes.data, times.ctypes.data, len(times), first, tol, *pointers)

    return run


def runs(
    program: Callable[[PartitionedSystem], Any], adaptive: bool, default: float | None
) -> tuple[Callable[[Task], Run], Callable[[Start], Calls]]:
    """Make the fields ``run`` and ``prepare`` of a `Peer` whose integration is a compiled function.

    ``program(system)`` returns that function, which takes adaptive steps if ``adaptive``, else fixed ones; ``default``
    is the tolerance of an adaptive peer if none is given.
    """

    def run(task: Task) -> Run:
        task = task._replace(tol=task.tol or default)
        return (_adaptive if adaptive else _fixed)(on_arrays(program(task.system), adaptive), task)

    def prepare(start: Start) -> Calls:
        from .prepared import SOLVED, STALLED, Calls

        call = on_arrays(program(start.system), adaptive)
        begin, y, counts = start.state, start.state, np.zeros(3, dtype=np.int64)
        rows, times, tol = np.zeros((2, len(y))), np.zeros(2), start.tol or default

        def restart(state: np.ndarray) -> None:
            begin[:] = state

        def to_time(t_end: float) -> int:
            y[:], times[1] = begin, t_end
            return STALLED if call(y, times, np.copysign(FIRST_STEP, t_end), tol, rows, counts) else SOLVED

        def by_steps(h: float, n: int) -> int:
            y[:] = begin
            return STALLED if call(y, h, n, counts) else SOLVED

        return Calls(restart, to_time if adaptive else by_steps, y.copy)

    return run, prepare


def _peer(id: str, header: str, kind: str, name: str, about: str, source: str, order: int | None = None) -> Peer:
    adaptive = kind == CONTROLLED
    tol = TOLERANCE if adaptive else None
    run, prepare = runs(lambda system: _program(system, header, kind), adaptive, tol)
    split = kind == SYMPLECTIC
    why = "its system is a pair of functions, q' = f(p) and p' = g(q): H must be T(p) + V(q)"
    facts = {"scope": "H = T(p) + V(q)", "lacks": split_alone(why)} if split else {}
    return Peer(
        f"boost-{id}",
        f"Boost.odeint's {name}",
        package="boost",
        adaptive=adaptive,
        order=order,
        license="BSL-1.0",
        about=f"{about}; compiled C++ with the problem's equations inside, by the flags of the bare C loop",
        source=source,
        run=run,
        prepare=prepare,
        claims=Claims(order=order, symplectic=True if split else None, source=TABLE),
        load=load_library,
        tol=tol,
        least=1e-15,
        rows_end_steps=adaptive,
        **facts,
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
