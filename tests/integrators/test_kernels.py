"""What every kernel keeps, on one method of each kind: bits without the compiler, backwards, in other units; counts.

How it stops, and that it does not allocate.
"""

from __future__ import annotations

import copy
import json
import sys
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from unittest.mock import patch

import numba
import numpy as np
import pytest
import sympy as sp
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys

from phasebench.benchmarks.measure.battery import BY_TRAIT, LOW_ORDER, SYSTEMS, as_problem, by_label, runs_on, variants
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, driver, integrate, integrate_ensemble, prepare, trajectory
from phasebench.integrators.compile import codegen, machine
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision
from phasebench.integrators.families import gauss_lanes, parametric
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.prepared import prepare as prepared_run
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.records.collocation import hbvm
from phasebench.integrators.records.projection import projection_method
from phasebench.integrators.registry import BY_ID, METHODS, method
from phasebench.integrators.stepping import kernel as stepping
from phasebench.integrators.systems.poisson import PoissonSystem
from support import plain
from support.one_of_each import FIRST, kinds
from support.plain import systems_for
from support.slips import leaves, replace_at
from support.solutions import last

NAMES = ("henon-heiles", "perturbed-kepler", "magnetic-mirror", "fpu", "kerr")
PROBLEMS = [problem(name) for name in NAMES] + [as_problem(name) for name in ("rods", "asymmetric-top", "many-parts")]


def problem_of(method):
    """A problem on which the method runs."""
    return next(made for made in PROBLEMS if not method.lacks(made.system))


# -- without the compiler: NumPy, and the stored end states ------------------------------------------------------------


@pytest.fixture(scope="module")
def there(uncompiled):
    """Method's label -> its ends without compilation."""
    return uncompiled("support/plain.py")


def test_end_states_are_the_stored_ones(there):
    """`python tests/support/plain.py --record` stores them anew and shows the difference."""
    known = plain.stored()
    assert set(there) == set(known) == set(plain.METHODS)
    assert not {label: said for label, ends in there.items() if (said := plain.apart(ends, known[label]))}
    assert not {label for label, ends in known.items() if not ends or {status for status, _ in ends.values()} != {"ok"}}


@pytest.mark.parametrize("label", plain.KINDS)
def test_compiled_and_uncompiled_runs_agree(there, label):
    names = [name for name in there[label] if name in plain.NAMES] or [*there[label]][:1]
    assert plain.apart(plain.ends(plain.KINDS[label], names), {name: there[label][name] for name in names}) == []


@pytest.mark.parametrize("label", ["kahan-li-8", "scheme-v-yoshida-4"])
def test_control_another_coefficient_ends_elsewhere(label):
    m = plain.METHODS[label]
    path, x = next(leaves(m.data))
    assert plain.apart(plain.ends(replace(m, data=replace_at(m.data, path, x * (1 + 1e-9)))), plain.stored()[label])


@pytest.mark.parametrize(
    "id", ["dop853", "symplectic-euler-q", "implicit-midpoint", "scheme-ii", "avf", "variational-lobatto-3"]
)
def test_arrays_and_tuples_agree(id, monkeypatch):
    """The system is made anew for each because functions are cached on it."""
    made, ends = problem("henon-heiles"), []
    for limit, kind in ((codegen.TUPLE_LIMIT, "tuple"), (1, "array")):
        monkeypatch.setattr(codegen, "TUPLE_LIMIT", limit)
        system = Hamiltonian(q=made.system.q, p=made.system.p, H=made.system.H)
        assert codegen.value_kind(system.d) == kind
        ends.append(last(integrate(system, id, h=0.05, steps=200, q0=made.q0, p0=made.p0)))
    assert np.abs(ends[0] - ends[1]).max() < 1e-12


# -- time and units ----------------------------------------------------------------------------------------------------

#: A magnetic field would have to be turned round, too. Steps that vary are chosen in each of their kinds.
VARYING = ("adaptive", "field", "wisdom_holman")
TURNED = {x: m for x, m in kinds().items() if m is FIRST[m.family] or m.family in VARYING}


@pytest.mark.parametrize("label", [x for x, m in TURNED.items() if "magnetic" not in m.requires])
def test_a_run_back_in_time_mirrors_the_run_ahead(label):
    made = problem_of(TURNED[label])
    ahead = integrate(made, TURNED[label], h=0.02, steps=50)
    back = integrate(made, TURNED[label], h=-0.02, steps=50, p0=[-x for x in made.p0])
    assert (ahead.status, back.status, back.t[-1]) == ("ok", "ok", -1.0)
    assert (back.t == -ahead.t).all()
    np.testing.assert_allclose(back.q, ahead.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.p, -ahead.p, rtol=0, atol=1e-12)
    assert np.abs(ahead.q[-1] - ahead.q[0]).max() > 1e-3


POWERS = (-24, 24)
#: Their norm of (q, p) is Euclidean by definition and depends on units: the controls.
EUCLIDEAN = {"discrete_gradient", "projection", "extended"}
#: Pendulums whose mass is not 1 in any units, with p and H in units of 2^k.
SCALED = {k: Hamiltonian(q="q", p="p", H=f"p**2*{2.0**-k!r} + {2.0**k!r}*(1 - cos(q))") for k in (0, *POWERS)}
#: The first method of each family and, where it has some, kind of tableau.
KINDS = {(m.family, *[x for x in m.data[:1] if isinstance(x, str)]): m for m in reversed(METHODS)}
UNITS = {m.id: m for m in KINDS.values() if not m.lacks(SCALED[0])}


def in_units(m, k: int):
    """The run of a method with p and H in units of 2^k: an array of q and p / 2^k, or None."""
    try:
        s = integrate(SCALED[k], m, h=0.1, steps=40, q0=[2.0], p0=[0.3 * 2.0**k])
    except ValueError:  # of the sine of infinity, uncompiled
        return None
    return np.hstack([s.q, s.p / 2.0**k]) if s.status == "ok" else None


def distances(label: str) -> list[float]:
    """Distances of a method's runs in other units from the one in units of 1."""
    own, *others = (in_units(UNITS[label], k) for k in (0, *POWERS))
    return [float("inf") if x is None else float(np.abs(x - own).max()) for x in others]


@pytest.mark.parametrize("label", UNITS)
def test_units_of_momenta_change_only_round_off(uncompiled, label):
    found = uncompiled("integrators/test_kernels.py", "units")[label]
    if UNITS[label].family in EUCLIDEAN:
        assert min(found) > 1e-9
    else:
        assert max(found) < 1e-12


# -- methods that are another one on some systems ----------------------------------------------------------------------

#: Method, another one, system, whether they are one.
SAME = [
    *(("cpg-1", "avf", name, True) for name in ("henon-heiles", "coupled")),
    *((hbvm(2, 2), "gauss-2", name, True) for name in ("henon-heiles", "coupled")),
    # Marsden & West 2001, 2.6.6; Ober-Bloebaum & Saake 2015
    ("variational-midpoint", "implicit-midpoint", "henon-heiles", True),
    ("variational-trapezoidal", "stormer-verlet", "henon-heiles", True),
    ("variational-gauss-2", "gauss-2", "henon-heiles", True),
    ("variational-lobatto-3", "lobatto-iiia-iiib-3", "henon-heiles", True),
    ("variational-2-3", "gauss-2", "henon-heiles", False),
    ("pavf", "avf", "henon-heiles", True),
    ("itoh-abe", "avf", "pendulum", True),
    ("pavf", "avf", "coupled", False),
    ("pihajoki-2", "stormer-verlet", "henon-heiles", True),
    ("tao-2", "stormer-verlet", "henon-heiles", False),
    (method("tao-2", omega=0), "pihajoki-2", "coupled", True),
    (method("scheme-ii", lam=0.3), method("generating-function", order=2, lam=0.3), "henon-heiles", True),
    (method("scheme-ii", lam=0.3), method("scheme-i", lam=0.3), "henon-heiles", False),
]


@pytest.mark.parametrize(("one", "other", "name", "same"), SAME, ids=lambda x: str(getattr(x, "label", x)))
def test_methods_that_are_one_on_a_system(one, other, name, same):
    ends = [last(integrate(as_problem(name), m, h=0.05, steps=40)) for m in (one, other)]
    apart = np.abs(ends[0] - ends[1]).max()
    assert apart < 1e-13 if same else apart > 1e-10


# -- steps too long for fixed-point iteration --------------------------------------------------------------------------

#: H = (p1^2 + p2^2)/2 + 200 q1^2 + q2^2/2 + q1^2 q2^2/2 + q1^4/4; the step is 6 over the largest frequency.
LONG_STEP, LONG_STEPS = Fraction(3, 10), 2
ENERGY = "(u**2 + v**2)/2 + 200*x**2 + y**2/2 + x**2*y**2/2 + x**4/4"
STIFF, STIFF_BACK = (Hamiltonian(q="x y", p="u v", H=f"{sign}({ENERGY})") for sign in ("", "-"))
STIFF_START = ([0.5, 1.0], [1.0, -0.5])
#: Families whose stages Newton's method solves, without two slow ones.
NEWTON = {"parametric", "collocation", "variational", "averaged", "discrete_gradient", "poisson"}


def _explicit(m) -> bool:
    """Return whether a step of the method m solves no equations on a separable system."""
    return m.family == "parametric" and parametric.is_splitting(m)


def _stiff_methods() -> dict:
    """Select one implicit method for each combination of family, symmetry, order and requirements, by label."""
    found: dict = {}
    for m in variants(lam=(Fraction(1, 3),), order=(2,)):
        if m.order <= LOW_ORDER and m.family in NEWTON and not _explicit(m) and m.lacks(STIFF) is None:
            found.setdefault((m.family, m.symmetric, m.symplectic, m.requires, m.order, "order" in m.parameters), m)
    return by_label(list(found.values()))


STIFF_METHODS = _stiff_methods()


def solve(system, m, start, **options):
    """The solution of a method on a system from ``start`` = (q, p)."""
    return integrate(system, m, h=LONG_STEP, steps=LONG_STEPS, q0=start[0], p0=start[1], **options)


def stiff_of(label: str) -> dict:
    """Run the method with this label on the stiff system: forwards, back again with -H, and in multiprecision.

    Returns a dict: "steps" and "newton", counts of steps and Newton solves of the three runs; "back", the distance from
    the start after the way back; "apart", the difference from multiprecision; "energy", the range of the energy.
    """
    m = STIFF_METHODS[label]
    there = solve(STIFF, m, STIFF_START)
    home = solve(STIFF_BACK, m, (there.q[-1], there.p[-1]))
    with precision(40):
        exact = solve(STIFF, m, STIFF_START, arithmetic=MULTIPRECISION)
        apart = [*map(float, (*(exact.q[-1] - there.q[-1]), *(exact.p[-1] - there.p[-1])))]
    return {
        "steps": [x.counts["steps"] for x in (there, home, exact)],
        "newton": [x.counts["newton"] for x in (there, home, exact)],
        "back": float(np.abs(np.array([home.q[-1], home.p[-1]]) - STIFF_START).max()),
        "apart": float(np.abs(apart).max()),
        "energy": float(np.ptp(STIFF.energies(there.q, there.p))),
    }


#: Bound on errors; states are of size 1, energies of 50, entries of the Jacobian of 60.
BOUND = 1e-12


@pytest.fixture(scope="module")
def results(uncompiled):
    """Method's label -> its results of `stiff_of`, runs with steps solved by Newton's method."""
    return uncompiled("integrators/test_kernels.py", "stiff")


@pytest.mark.parametrize("label", STIFF_METHODS)
def test_doubles_and_multiprecision_solve_the_same_equations(results, label):
    found = results[label]
    assert found["steps"] == 3 * [LONG_STEPS]
    assert min(found["newton"]) >= LONG_STEPS
    assert found["apart"] < BOUND


@pytest.mark.parametrize("label", [label for label, m in STIFF_METHODS.items() if m.symmetric])
def test_symmetric_methods_return(results, label):
    assert results[label]["back"] < BOUND


@pytest.mark.parametrize("label", [label for label, m in STIFF_METHODS.items() if m.energy == ROUND_OFF])
def test_energy_is_conserved_where_declared(results, label):
    assert results[label]["energy"] < BOUND


def test_control_other_methods_neither_return_nor_conserve_energy(results):
    assert results["implicit-euler"]["back"] > 0.1
    assert results["implicit-midpoint"]["energy"] > 0.01


def test_every_family_is_tested():
    assert {m.family for m in STIFF_METHODS.values()} == NEWTON


# -- counts and ends ---------------------------------------------------------------------------------------------------

SHORT_STEP, SHORT_STEPS = 0.02, 3
COUNTED_ON = ("henon-heiles", "coupled", "perturbed-kepler")
#: Systems per method; a separable and a non-separable one suffice.
FEW = 2
#: Runs with so long steps that fixed-point iteration fails.
LONG = ("stiff", "body", "lanes")
#: The counts of a solution that are compared.
TOLD = ("gradient", "steps", "newton", "fallbacks", "iterations")
#: Functions of constraints.
CONSTRAINTS = ("restore", "normal", "multipliers", "transposed slopes", "mobility")
#: Prefixes of functions that do not count as gradient or field evaluations.
OTHERS = ("structure", "energy", "grad_T", "constraint", "velocity", "rate", "density", "A / m", *CONSTRAINTS)


def counted_systems(m) -> list[str]:
    """Return the names of the systems on which the calls of the method m are counted."""
    names = BY_TRAIT.get(m.requires[0], COUNTED_ON) if m.requires else COUNTED_ON
    return [name for name in names if runs_on(m, name)][:FEW]


LOW = [m for m in variants(lam=(Fraction(1, 3),), order=(1, 2)) if m.order <= LOW_ORDER and counted_systems(m)]
COUNTED = kinds(LOW) | by_label([m for m in LOW if m.label in STIFF_METHODS])
LANED = [x for x, m in COUNTED.items() if m.data[:1] == ("gauss",) and gauss_lanes.serves(m.data[1], STIFF)]


def watch(system, calls: Counter):
    """Return a copy of the system whose functions (gradient, field, ...) count their calls, by kind, in ``calls``."""
    other, kind_of_system = copy.copy(system), type(system)
    other._functions = {}

    def made(kind, *rest):
        function = kind_of_system.make_function(other, kind, *rest)

        def called(*arguments):
            calls[kind] += 1
            return function(*arguments)

        return called

    other.make_function = made
    return other


def body() -> PoissonSystem:
    """Return a Poisson system: a rigid body y' = y x grad H with a quartic term, and a constant fourth variable."""
    x, y, z, rest = sp.symbols("x y z rest", real=True)
    B = [[0, -z, y, 0], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]]
    return PoissonSystem(q=[x, y], p=[z, rest], B=B, H=x**2 / 2 + y**2 / 3 + z**2 / 5 + x**4 / 20 + y * z / 4)


def counted_runs(label: str) -> dict:
    """{name of the run: (system, step h, initial (q, p))}; steps of those in `LONG` are solved by Newton's method."""
    found = {}
    for name in counted_systems(COUNTED[label]):
        system, *start = SYSTEMS[name]()
        found[name] = system, SHORT_STEP, start
    found |= {"stiff": (STIFF, LONG_STEP, STIFF_START)} if label in STIFF_METHODS else {}
    return found | ({"body": (body(), 3.0, ((0.8, -0.5), (0.6, 1.0)))} if COUNTED[label].family == "poisson" else {})


def counts_of(label: str) -> dict:
    """{name of the run: counts} of the method with this label.

    Counts are those that the solution reports, "called" those of the system's functions, and "kernel" those of the
    kernel when it is called directly.  Stages share SIMD lanes only in the run "lanes" of Gauss methods.
    """
    found = {}
    for name, (system, h, (q, p)) in counted_runs(label).items():
        calls = Counter()
        with patch.object(gauss_lanes, "FEWEST", 99):
            s = integrate(watch(system, calls), COUNTED[label], h=h, steps=SHORT_STEPS, q0=q, p0=p, save_every=2)
            kernel = kernel_counts(stepping.prepare(COUNTED[label], system), system.d, float(h), q, p)
        found[name] = {key: s.counts[key] for key in TOLD}
        found[name]["called"] = sum(n for kind, n in calls.items() if not kind.startswith(OTHERS))
        found[name]["kernel"] = kernel
    return found | ({"lanes": in_lanes(label)} if label in LANED else {})


def in_lanes(label: str) -> dict:
    """Count the evaluations of a Gauss method whose stages share SIMD lanes, on steps that Newton's method solves."""
    prepared, calls = stepping.prepare(COUNTED[label], STIFF), []
    f, stages = prepared.step.f, prepared.step.stages

    def called(memory):
        calls.append(stages)
        f(memory)

    watched = replace(prepared, step=prepared.step._replace(f=called))
    kernel = kernel_counts(watched, 2, float(LONG_STEP), *STIFF_START)
    return kernel | {"called": sum(calls), "kernel": kernel}


def kernel_counts(prepared, d: int, h: float, q, p) -> dict:
    """The counts of a kernel that is called for two steps, then for the rest, by the names in `TOLD`."""
    run = lay_out(prepared, d, h, q, p)
    for every in (2, SHORT_STEPS - 2):
        run(np.zeros((1, d)), np.zeros((1, d)), np.zeros((1, 1)), every)
    tally = prepared.tally(*(int(run.counts[name]) for name in ("steps", "gradient", "fallbacks", "newton")))
    return {key: tally[key] for key in TOLD}


#: Families that solve no equation with the gradient; "parametric" and its projections do if H is not separable.
EXPLICIT = {"runge_kutta", "splitting", "processed", "force_gradient", "relaxation", "trigonometric", "wisdom_holman"}
EXPLICIT |= {"magnetic", "extended", "parts", "rattle", "rigid"}
EXPLICIT_ONES = {"variational-trapezoidal", "stormer-verlet-adaptive"}


@pytest.mark.parametrize("label", COUNTED)
def test_counts_are_those_of_the_calls(uncompiled, label):
    """Of the solution as of the kernel; only long steps need Newton's method."""
    family, found = COUNTED[label].family, uncompiled("integrators/test_kernels.py", "counts")[label]
    varying = family in ("adaptive", "field")  # a solution counts steps of length h, a kernel those it took
    explicit = family in EXPLICIT or label in EXPLICIT_ONES
    assert len(found) > (label in STIFF_METHODS)
    for name, told in found.items():
        assert told["gradient"] == told["called"] > 0, name
        assert varying or told["steps"] == SHORT_STEPS
        assert (told["newton"] > 0, told["fallbacks"]) == (name in LONG, 0), name
        for key in {*TOLD} - ({"steps"} if varying else set()):
            assert told["kernel"][key] == told[key], (name, key)
        if family not in ("parametric", "projection"):
            assert told["iterations"] == (0 if explicit else told["gradient"]), name


@pytest.mark.parametrize(
    "id", ["rk4", "stormer-verlet", "stormer-verlet-dkd", "symplectic-euler-q", "implicit-midpoint"]
)
@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
def test_what_is_solved_is_counted_as_iterations(id, name):
    system, q, p = SYSTEMS[name]()
    implicit = id == "implicit-midpoint" or (id != "rk4" and name == "coupled")
    for m in (id, projection_method(id)) if "euler" not in id and "dkd" not in id else (id,):
        found = integrate(system, m, h=SHORT_STEP, steps=3, q0=q, p0=p).counts
        assert (found["iterations"] > 0) == implicit


STOP_STEP, STOP_STEPS = 0.25, 12
#: Families that take seconds for such a run without compilation.
SLOW = {"equip"}
#: q1 escapes to infinity in finite time: implicit equations lose their solution, explicit steps overflow.
RUNAWAY = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - x**4 + y**2/2")


def _stopping() -> dict:
    """Select a few methods of each family, explicit and implicit, by label."""
    found: dict = {}
    for m in variants(lam=(Fraction(1, 3),), order=(2,)):
        if m.order <= LOW_ORDER and m.family not in SLOW and m.lacks(RUNAWAY) is None:
            found.setdefault((m.family, m.symmetric, m.requires), m)
    return by_label(list(found.values()))


STOPPED = _stopping()


def stops_of(label: str) -> dict:
    """{spacing of the stored rows: [status, steps taken, gradient evaluations, stored rows (q, p)]} of a method."""
    ends = {}
    with np.errstate(all="ignore"):
        for every in (1, 5, 0):
            start = {"q0": [1.0, 0.5], "p0": [1.0, 0.0]}
            s = integrate(RUNAWAY, STOPPED[label], h=STOP_STEP, steps=STOP_STEPS, save_every=every, **start)
            ends[str(every)] = [s.status, s.counts["steps"], s.counts["gradient"], np.hstack([s.q, s.p]).tolist()]
    return ends


@pytest.mark.parametrize("label", STOPPED)
def test_a_run_ends_alike_for_any_spacing_of_rows(uncompiled, label):
    found = uncompiled("integrators/test_kernels.py", "stops")[label]
    (status, reached, evaluations, states), *others = (found[every] for every in ("1", "5", "0"))
    whole = status in ("ok", "inaccurate", "unstable", "no-root")  # a step without a root does not end a run
    assert whole == (reached == STOP_STEPS)
    for (end, steps, more, rows), fewer in zip(others, (5 * (reached // 5), 0), strict=True):
        assert (end, steps) == (status, reached if whole else fewer)
        assert rows[-1] == states[steps]
        assert status == "diverged" or more == evaluations  # an overflow is noticed only at a stored row


def test_every_kind_of_end_occurs(uncompiled):
    found = {ends["1"][0] for ends in uncompiled("integrators/test_kernels.py", "stops").values()}
    assert found >= {"ok", "unstable", "diverged", "not-converged"}


# -- no allocation -----------------------------------------------------------------------------------------------------


def allocations(work) -> int:
    """How many times Numba's runtime allocated while ``work`` ran."""
    rtsys.initialize(cpu_target.target_context)
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    work()
    after = rtsys.get_allocation_stats()
    return (after.alloc - before.alloc) + (after.mi_alloc - before.mi_alloc)


def grown(made, id, h) -> int:
    """Allocations of a thousand steps minus those of ten."""
    run = prepared_run(made, id)
    few, many = (lambda n=n: run(h, n) for n in (10, 1000))
    assert (few()[2], many()[2]) == (run.SOLVED, run.SOLVED), "all steps are taken"
    return allocations(many) - allocations(few)


@pytest.mark.parametrize("id", sorted(m.id for m in FIRST.values()))
def test_no_step_allocates(id):
    assert grown(problem_of(BY_ID[id]), id, 0.01) == 0


LARGE = {"fpu": {"m": 11}, "nls": {"N": 24}}


@pytest.mark.parametrize(("name", "id"), [("fpu", "stormer-verlet"), ("fpu", "rk4"), ("nls", "rk4")])
def test_no_explicit_step_on_arrays_allocates(name, id):
    assert grown(problem(name, **LARGE[name]), id, 1e-3) == 0


def test_control_an_implicit_step_on_arrays_allocates():
    assert grown(problem("fpu", m=11), "implicit-midpoint", 1e-3) > 1000


@pytest.mark.parametrize("label", kinds())
def test_kernels_are_compiled_without_the_runtime(label, monkeypatch):
    """Numba's runtime would do the allocating; the kernel and its functions are compiled without it."""
    asked, m = [], kinds()[label]
    system = problem_of(m).system
    prepared = stepping.prepare(m, system)
    with monkeypatch.context() as patch:
        patch.setattr(stepping, "_kernels", {})
        patch.setattr(machine, "load_or_compile", lambda *arguments: asked.append(arguments))
        stepping.kernel(prepared, system.d)
    assert [options["_nrt"] for _, _, options, _ in asked] == [False]
    steps = prepared.step, *(part for part in prepared.step if isinstance(part, tuple))
    functions = [f for part in steps for f in part if callable(f)]
    assert functions
    assert {getattr(f, "dispatcher", f).targetoptions["_nrt"] for f in functions} == {False}


def test_control_the_compiler_refuses_allocations():
    def allocates(n):
        return np.empty(n).sum() * 0.0

    small, large = codegen.options(codegen.TUPLE_LIMIT), codegen.options(codegen.TUPLE_LIMIT + 1)
    assert (small["_nrt"], large.get("_nrt", True)) == (False, True)
    assert numba.njit(**large)(allocates)(0) == 0
    with pytest.raises(numba.core.errors.NumbaError):
        numba.njit(**small)(allocates)(0)


# -- what is carried from step to step: rows, calls of the kernel and neighbours change nothing ------------------------


#: The first of each family, and those that keep more than it: a copy, a relaxed time, a corrector, a processor.
IDS = [
    *(m.id for m in FIRST.values()),
    *("tao-2", "scheme-v", "rk4-relaxation", "wisdom-holman-corrector", "blanes-casas-ros-p3"),
    *("implicit-midpoint-symmetric-projection", "lie-midpoint", "he-splitting-4", "gauss-8-adaptive", "cpg-2"),
]
STEPS, H = 30, 0.05


def start(id: str) -> tuple:
    """(system, q, p) on which a method runs."""
    return SYSTEMS[systems_for(method(id))[0]]()


@pytest.mark.parametrize("id", dict.fromkeys(IDS))
def test_rows_and_calls_of_the_kernel_do_not_change_the_orbit(id, monkeypatch):
    system, q, p = start(id)
    every, some = (integrate(system, id, h=H, steps=STEPS, q0=q, p0=p, save_every=n) for n in (1, 7))
    for module in (driver, trajectory):
        monkeypatch.setattr(module, "PIECE", 4)
    pieces = integrate(system, id, h=H, steps=STEPS, q0=q, p0=p, save_every=0)
    run = prepare(system, id, q0=q, p0=p)
    run(0.9 * H, 5)
    again = np.concatenate(run(H, STEPS)[:2])
    assert every.status == some.status == pieces.status == "ok"
    assert np.abs(some.q[:-1] - every.q[:-1:7]).max() < 1e-14
    end = np.concatenate([every.q[-1], every.p[-1]])
    for s in (some, pieces):
        assert np.abs(np.concatenate([s.q[-1], s.p[-1]]) - end).max() < 1e-14
    assert np.abs(again - end).max() < 1e-14
    assert np.abs(end - [*q, *p]).max() > 1e-3


@pytest.mark.parametrize("id", dict.fromkeys(IDS))
def test_orbits_side_by_side_are_those_alone(id):
    system, q, p = start(id)
    n = 9
    P = np.array(p) * (1 + np.linspace(0, 0.05, n))[:, None]
    many = integrate_ensemble(system, id, np.tile(q, (n, 1)), P, h=H, steps=STEPS)
    assert set(many.status) == {"ok"}
    for k in (0, 4, n - 1):
        alone = integrate(system, id, h=H, steps=STEPS, q0=q, p0=P[k], save_every=0)
        assert np.abs(np.concatenate([many.q[k] - alone.q[-1], many.p[k] - alone.p[-1]])).max() < 1e-13
    assert np.ptp(many.q[:, 0]) > 1e-4, "the control: the orbits differ"


def momentum_of_leapfrog(h: float, steps: int) -> float:
    """The largest change of the angular momentum on the Kepler problem by leapfrog, as plain sums."""
    x, y, u, v = 0.8, 0.3, -0.2, 0.9
    L, worst = x * v - y * u, 0.0
    for _ in range(steps):
        x, y = x + h / 2 * u, y + h / 2 * v
        f = -h / (x * x + y * y) ** 1.5
        u, v = u + f * x, v + f * y
        x, y = x + h / 2 * u, y + h / 2 * v
        worst = max(worst, abs(x * v - y * u - L))
    return worst


@pytest.mark.parametrize("id", ["wisdom-holman", "stormer-verlet", "pefrl", "chin-4a", "gauss-2"])
def test_what_rounding_loses_of_a_step_is_carried_to_the_next(id):
    """Short steps keep the angular momentum to round-off; plain sums (the control) lose ten times as much."""
    system, q, p = SYSTEMS["perturbed-kepler"]()
    s = integrate(system, id, h=1e-3, steps=100_000, save_every=1000, q0=q, p0=p)
    L = s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0]
    assert np.abs(L - L[0]).max() < 2e-15
    assert momentum_of_leapfrog(1e-3, 100_000) > 1e-14


if __name__ == "__main__":
    measured = {
        "units": (distances, UNITS),
        "counts": (counts_of, COUNTED),
        "stiff": (stiff_of, STIFF_METHODS),
        "stops": (stops_of, STOPPED),
    }
    of, labels = measured[sys.argv[1]]
    print(json.dumps({"result": {label: of(label) for label in labels}}))
