"""What every kernel keeps, on one method of each kind: bits without the compiler, backwards, in other units; counts.

How it stops, and that it does not allocate.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys

from phasebench.benchmarks.measure.battery import SYSTEMS, as_problem
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.compile import codegen, machine
from phasebench.integrators.prepared import prepare as prepared_run
from phasebench.integrators.records.collocation import hbvm
from phasebench.integrators.records.projection import projection_method
from phasebench.integrators.registry import BY_ID, METHODS, method
from phasebench.integrators.stepping import kernel as stepping
from support import counts, plain, stiff, stops
from support.kinds import arrays_and_tuples_apart
from support.marks import compiled
from support.one_of_each import FIRST, kinds
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
    assert codegen.compiled()
    names = [name for name in there[label] if name in plain.NAMES] or [*there[label]][:1]
    assert plain.apart(plain.ends(plain.KINDS[label], names), {name: there[label][name] for name in names}) == []


@pytest.mark.parametrize("label", ["kahan-li-8", "scheme-v-yoshida-4"])
def test_control_another_coefficient_ends_elsewhere(label):
    m = plain.METHODS[label]
    path, x = next(leaves(m.data))
    assert plain.apart(plain.ends(replace(m, data=replace_at(m.data, path, x * (1 + 1e-9)))), plain.stored()[label])


@compiled
@pytest.mark.parametrize(
    "id", ["dop853", "symplectic-euler-q", "implicit-midpoint", "scheme-ii", "avf", "variational-lobatto-3"]
)
def test_arrays_and_tuples_agree(id):
    assert arrays_and_tuples_apart(id) < 1e-12


# -- time and units ----------------------------------------------------------------------------------------------------

#: A magnetic field has to be turned round, too: test_magnetic.py. Steps that vary are chosen in each of their kinds.
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


def distances(m) -> list[float]:
    """Distances of the runs in other units from the one in units of 1."""
    own, *others = (in_units(m, k) for k in (0, *POWERS))
    return [float("inf") if x is None else float(np.abs(x - own).max()) for x in others]


@pytest.mark.parametrize("label", UNITS)
def test_units_of_momenta_change_only_round_off(uncompiled, label):
    found = uncompiled("integrators/test_kernels.py")[label]
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
    ("variational-gauss-3", "gauss-3", "henon-heiles", True),
    ("variational-lobatto-3", "lobatto-iiia-iiib-3", "henon-heiles", True),
    ("variational-lobatto-4", "lobatto-iiia-iiib-4", "henon-heiles", True),
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


# -- counts and ends ---------------------------------------------------------------------------------------------------

#: Families that solve no equation with the gradient; "parametric" and its projections do if H is not separable.
EXPLICIT = {"runge_kutta", "splitting", "processed", "force_gradient", "relaxation", "trigonometric", "wisdom_holman"}
EXPLICIT |= {"magnetic", "extended", "parts", "rattle", "rigid"}
EXPLICIT_ONES = {"variational-trapezoidal", "stormer-verlet-adaptive"}


@pytest.mark.parametrize("label", counts.ALL)
def test_counts_are_those_of_the_calls(of_each, label):
    """Of the solution as of the kernel; only long steps need Newton's method."""
    family, found = counts.ALL[label].family, of_each(counts)(label)
    varying = family in ("adaptive", "field")  # a solution counts steps of length h, a kernel those it took
    explicit = family in EXPLICIT or label in EXPLICIT_ONES
    assert len(found) > (label in stiff.METHODS)
    for name, told in found.items():
        assert told["gradient"] == told["called"] > 0, name
        assert varying or told["steps"] == counts.STEPS
        assert (told["newton"] > 0, told["fallbacks"]) == (name in counts.LONG, 0), name
        for key in {*counts.TOLD} - ({"steps"} if varying else set()):
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
        found = integrate(system, m, h=counts.H, steps=3, q0=q, p0=p).counts
        assert (found["iterations"] > 0) == implicit


@pytest.mark.parametrize("label", stops.ALL)
def test_a_run_ends_alike_for_any_spacing_of_rows(of_each, label):
    (status, reached, evaluations, states), *others = (of_each(stops)(label)[every] for every in ("1", "5", "0"))
    whole = status in ("ok", "inaccurate", "unstable", "no-root")  # a step without a root does not end a run
    assert whole == (reached == stops.STEPS)
    for (end, steps, more, rows), fewer in zip(others, (5 * (reached // 5), 0), strict=True):
        assert (end, steps) == (status, reached if whole else fewer)
        assert rows[-1] == states[steps]
        assert status == "diverged" or more == evaluations  # an overflow is noticed only at a stored row


def test_every_kind_of_end_occurs(of_each):
    assert {of_each(stops)(x)["1"][0] for x in stops.ALL} >= {"ok", "unstable", "diverged", "not-converged"}


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


if __name__ == "__main__":
    print(json.dumps({"result": {label: distances(m) for label, m in UNITS.items()}}))
