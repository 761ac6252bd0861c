"""Arguments of a run: times, rows, the start, names; what is refused; runs back in time and in many digits."""

from __future__ import annotations

import inspect
import json
import re
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, driver, integrate, integrate_ensemble, prepare, request
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number
from phasebench.integrators.driver import COLLISION, DIVERGED, INACCURATE, NOT_CONVERGED, OK, UNSTABLE
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.names import aliases, normalize
from phasebench.integrators.registry import BY_ID, METHODS, method
from phasebench.integrators.request import MOST, check_timeout, grid, initial, spacing
from phasebench.integrators.section import section
from phasebench.integrators.stepping.orbit_lanes import LANES
from phasebench.reference.peers import BY_ID as PEERS
from support.one_of_each import FIRST

PLANE = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2 + x**2 + y**2)/2 + x*y**2")
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")


class StartedProblem:
    """Stand-in for a problem with one initial state."""

    system, q0, p0 = PLANE, (1.0, 2.0), (3.0, 4.0)


#: (h, t_end, steps, t0) -> (h with its sign, steps).
GRIDS = [
    ((0.25, 10.0, None), (0.25, 40)),
    ((0.25, None, 7), (0.25, 7)),
    ((None, 10.0, 4), (2.5, 4)),
    ((2.5 * (1 + 1e-10), 10.0, 4), (2.5, 4)),
    ((0.331, 10.0, None), (10 / 30, 30)),  # 0.7 % longer
    ((5.0, 2.0, None), (2.0, 1)),
    ((None, 3, 1.0), (3.0, 1)),
    ((0.1, 0.3, None), (0.1, 3)),  # h as given, although 3 h differs from 0.3 in the last bit
    ((1.0, MOST, None), (1.0, 10**13)),
    ((0.1, -10.0, None), (-0.1, 100)),
    ((-0.1, -10.0, None), (-0.1, 100)),
    ((0.1, 5.0, None, 15.0), (-0.1, 100)),
    ((0.1, 5.0, None, -5.0), (0.1, 100)),
    ((-0.1, None, 7, 3.0), (-0.1, 7)),
    ((None, -1.0, 4, 1.0), (-0.5, 4)),
]


@pytest.mark.parametrize(("asked", "made"), GRIDS)
def test_two_of_h_t_end_and_steps_make_a_grid(asked, made):
    h, steps = grid(*asked)
    assert (h, steps, type(h), type(steps)) == (pytest.approx(made[0], rel=1e-15), made[1], float, int)


NO_GRIDS = [
    ((0.5, 10.0, 4), r"steps times h is 2\.0, not t_end = 10\.0"),
    ((2.5 * (1 + 1e-8), 10.0, 4), "steps times h"),
    ((2.9, 6.5, None), r"are 3\.25 \(2 steps\) and 2\.1666666666666665 \(3 steps\)"),
    ((None, 1.0, None), "give the step h"),
    ((0.1, None, None), "where does the integration end"),
    ((0.1, None, 2 * MOST), r"steps is 2e\+13; the most is 1e13"),
    ((0.1, MOST, None), r"t_end/h asks for 1e\+14 steps"),
    ((0.1, None, 2.5), "steps is 2.5"),
    ((True, 1.0, None), "h is True"),
    ((float("nan"), 1.0, None), "h is nan"),
    ((0.1, float("inf"), None), "t_end is inf"),
    ((10**5000, 1.0, None), "h is an integer beyond the doubles"),
    ((0.1, None, 10**400), "steps is an integer beyond the doubles"),
    ((0, 1.0, None), "h is 0;"),
    ((0.1, None, -3), "steps is -3"),
    (("0.1", 1.0, None), "h is '0.1'"),
    ((-0.1, 10.0, None), "lies ahead"),
    ((0.1, -1.0, None, -1.0), "where the integration begins"),
    ((0.1, 3.0, None, float("nan")), "t0 is nan"),
]


@pytest.mark.parametrize(("asked", "message"), NO_GRIDS)
def test_an_invalid_grid_is_refused(asked, message):
    with pytest.raises(InvalidInput, match=message):
        grid(*asked)


NO_SPACINGS = [-1, 0.5, True, None, "2", float("nan"), float("inf"), 10**400]


def test_row_spacings_and_time_limits():
    for asked, every in ((1, 1), (9, 9), (30, 9), (0, 9), (2.0, 2)):
        assert (spacing(asked, 9), type(spacing(asked, 9))) == (every, int)
    for timeout in (None, 1, Fraction(1, 3), float("inf")):
        check_timeout(timeout)
    for asked in NO_SPACINGS:
        with pytest.raises(InvalidInput, match=r"save_every is .*positive integer, or 0"):
            spacing(asked, 9)
    for timeout in (0, -1, True, "1", float("nan"), [1], 10**400):
        with pytest.raises(InvalidInput, match=r"timeout is .*positive number of seconds"):
            check_timeout(timeout)


def test_rows_are_multiples_of_the_spacing_and_the_last(monkeypatch):
    for every, numbers in ((3, [0, 3, 6, 9, 10]), (5, [0, 5, 10]), (0, [0, 10])):
        assert request.request(StartedProblem(), h=0.1, steps=10, save_every=every).step_numbers == numbers
    monkeypatch.setattr(request, "LARGEST", 22)  # numbers: with d = 2, eleven rows
    for steps, every in ((10, 1), (30, 3)):
        assert request.request(StartedProblem(), h=0.1, steps=steps, save_every=every).every == every
        with pytest.raises(InvalidInput, match="12 rows of d = 2"):
            request.request(StartedProblem(), h=0.1, steps=steps + 1, save_every=every)


def test_the_initial_state_defaults_to_the_problems():
    for given, q, p in (({}, [1, 2], [3, 4]), ({"p0": [5, 6]}, [1, 2], [5, 6]), ({"q0": [[0], [0]]}, [0, 0], [3, 4])):
        system, *found = initial(StartedProblem(), **given)
        assert (system, [x.tolist() for x in found]) == (PLANE, [q, p])
    third = [Fraction(1, 3), Fraction(2, 3)]
    assert initial(PLANE, third, third, exact=True)[1] is third


NO_STATES = [
    ((PLANE, None, [0, 0]), "give q0"),
    ((PLANE, [0], [0, 0]), "q0 has 1 components; the problem has d = 2"),
    ((PLANE, [0, 0], []), "p0 has 0 components"),
    ((PLANE, [0, "a"], [0, 0]), "q0 is .*must be numbers"),
    ((PLANE, [0, 1j], [0, 0]), "q0 is .*must be numbers"),
    ((PLANE, [0, 0], [0, None]), r"p0 is \[0\.0, nan\]; every component"),
    ((PLANE, [1e200, 0], [0, 0]), "the energy of the initial state is inf"),
    (("plane", [0, 0], [0, 0]), "the problem is 'plane'"),
    ((OSCILLATOR, [1.001e150], [0.0]), "choose units"),
    ((OSCILLATOR, [0.999e-150], [0.0]), "choose units"),
    ((problem("kepler").system, [0.0, 0.0], [0.0, 1.0]), "singularity"),
    ((problem("lotka-volterra").system, [-1.0], [1.0]), "domain"),
]


@pytest.mark.parametrize(("asked", "message"), NO_STATES)
def test_an_invalid_state_is_refused(asked, message):
    with pytest.raises(InvalidInput, match=message):
        initial(*asked)


def test_a_warm_run_returns_the_end_state():
    asked = {"problem": StartedProblem(), "method": "stormer-verlet", "h": 0.01, "steps": 5}
    s = integrate(**asked)
    assert np.array_equal(driver.warm(**asked)(), [s.q[-1], s.p[-1]])


def test_ensembles_sections_and_prepared_runs_go_back():
    made, n = problem("henon-heiles"), LANES.n + 1
    Q, P = np.array([[0.0, 0.1 + 0.01 * k] for k in range(n)]), np.tile([0.3, 0.1], (n, 1))
    ahead, back = (integrate_ensemble(made, "stormer-verlet", Q, s * P, h=0.1, t_end=s * 20.0) for s in (1, -1))
    assert back.in_lanes.all()
    assert ahead.in_lanes.all()
    assert (back.t == -ahead.t).all()
    np.testing.assert_allclose([back.q, -back.p], [ahead.q, ahead.p], atol=1e-12)
    times = {
        (s, turned): section(made, "stormer-verlet", Q, s * P, of="q1", rising=rising, h=0.1, t_end=s * 20.0).t
        for s, turned, rising in ((1, False, True), (1, True, False), (-1, False, True), (-1, True, False))
    }
    for turned in (False, True):
        assert len(times[1, turned]) > 20
        np.testing.assert_allclose(times[-1, turned], -times[1, turned], atol=1e-9)
    run = prepare(problem("pendulum"), "stormer-verlet")
    q, p, _ = run(0.1, 30)
    q, p, _ = run(-0.1, 30, q0=q, p0=p)
    np.testing.assert_allclose([*q, *p], [*problem("pendulum").q0, *problem("pendulum").p0], atol=1e-12)


#: Arguments that runs in doubles and in many digits refuse, and how.
REFUSED = (
    ({"h": Fraction(1, 10)}, "give t_end or steps"),
    ({"t_end": 1}, "give the step h"),
    ({"h": 0, "steps": 3}, "h is 0"),
    ({"h": Fraction(3, 10), "t_end": 1}, "does not divide"),
)


def refuse(**more) -> None:
    for asked, why in REFUSED:
        with pytest.raises(InvalidInput, match=why):
            integrate(OSCILLATOR, "stormer-verlet", q0=[1.0], p0=[0.0], **asked, **more)


def many() -> dict:
    """Multiprecision runs from q = p = 1/3 over seven steps 1/10: {name: (rows, steps, end time, error, status)}."""
    q = p = Fraction(1, 3)
    for _ in range(7):
        p -= q / 20
        q += p / 10
        p -= q / 20
    tenth, third, found = Fraction(1, 10), [Fraction(1, 3)], {}
    with precision(40):
        runs = {
            "steps": {"h": tenth, "steps": 7},
            "a step that nearly divides it": {"h": 0.1, "t_end": 7 * tenth},
            "later start": {"h": tenth, "t0": -2, "t_end": -13 * tenth},
            "rows": {"h": tenth, "steps": 7, "save_every": 3},
            "mpmath": {"h": mpmath.mpf(1) / 10, "t_end": mpmath.mpf(7) / 10},
        }
        for name, asked in runs.items():
            s = integrate(OSCILLATOR, "stormer-verlet", q0=third, p0=third, arithmetic=MULTIPRECISION, **asked)
            lost = abs(3 * s.q[0, 0] - 1) + abs(10 * s.h - 1) + abs(s.q[-1, 0] - to_number(q, MULTIPRECISION))
            found[name] = [len(s.t), s.counts["steps"], float(s.t[-1] - s.t[0]), float(lost), s.status]
        refuse(arithmetic=MULTIPRECISION)
    return found


def test_multiprecision_uses_the_same_grids_exactly(uncompiled):
    refuse()
    for name, (rows, *found, lost, status) in uncompiled("integrators/test_request.py").items():
        assert (rows, found, status) == (4 if name == "rows" else 8, [7, pytest.approx(0.7, rel=1e-15)], "ok"), name
        assert lost < 1e-38, name


# -- unusable names, parameters and systems raise InvalidInput; trouble on the way is a status ------------------------


PENDULUM, KEPLER, LOTKA = problem("pendulum"), problem("kepler"), problem("lotka-volterra")


def test_a_misspelt_method_and_an_unknown_parameter_are_refused():
    for record in METHODS:
        wrong = record.id[:-1] + ("x" if record.id[-1] != "x" else "y")
        with pytest.raises(InvalidInput, match=rf"did you mean.*{re.escape(record.id)}"):
            method(wrong)
        with pytest.raises(InvalidInput, match=f"'{record.id}' has no parameter 'nonsense'"):
            method(record.id, nonsense=1)
    for id, words in (("scheme-i", "it has lam$"), ("rk4", "it has none$"), ("generating-function", "it has .*, ")):
        with pytest.raises(InvalidInput, match=words):
            method(id, mu=1)


def test_an_unknown_name_lists_at_most_twenty_known_ones():
    with pytest.raises(InvalidInput, match=r"known are .*, avf, .* more \(`phasebench list`\)"):
        method("qqqqqqqqqq")
    names = [f"n{k:02}" for k in range(23)]
    for known, more in ((20, ""), (21, " and 1 more "), (23, " and 3 more ")):
        said = str(unknown_name("number", "qqqqqq", names[:known]))
        assert (said.count(", n"), more in said, " more " in said) == (19, True, bool(more))


@pytest.mark.parametrize(
    ("name", "meant"),
    [("yoshida-4", "forest-ruth"), ("velocity_verlet", "stormer-verlet"), ("Störmer-Verlet", "stormer-verlet")]
    + [("RK4", "rk4"), ("leapfrog", "stormer-verlet"), ("mclachlan", "mclachlan-ss5")],
)
def test_names_of_the_field_are_suggested_and_not_taken(name, meant):
    for ask in (pb.method, pb.METHODS.__getitem__, pb.integrator):
        with pytest.raises(pb.InvalidInput, match="did you mean") as told:
            ask(name)
        assert meant in str(told.value).partition("did you mean ")[2].rstrip("?").split(" or ")


def test_aliases_name_what_exists_and_are_no_ids():
    assert {id for ids in aliases().values() for id in ids} <= {*BY_ID, *PEERS}
    assert all(normalize(name) == name for name in aliases())
    assert not {normalize(id) for id in BY_ID} & {*aliases()}


def test_records_go_by_id_and_by_position():
    assert pb.METHODS["rk4"] is pb.method("rk4") is pb.method(pb.METHODS["rk4"])
    assert ("rk4" in pb.METHODS, "heyoka" in pb.METHODS, pb.METHODS[0] in pb.METHODS) == (True, False, True)
    assert [m.id for m in pb.METHODS[:2]] == [m.id for m in pb.METHODS][:2]
    with pytest.raises(pb.InvalidInput, match="no peer 'rk4'"):
        pb.PEERS["rk4"]


@pytest.mark.parametrize("value", ["a third", float("nan"), float("inf"), None, [1], "1/0", "", True, "nan", 1j])
def test_a_parameter_that_is_not_a_number_is_refused(value):
    for record in METHODS:
        if "lam" in record.parameters:
            with pytest.raises(InvalidInput, match=r"lam is .*finite number"):
                record(lam=value)
    with pytest.raises(InvalidInput, match=r"the parameter order is .*an integer"):
        method("generating-function", order=value)


def test_numbers_are_read_exactly():
    third = np.longdouble(1) / 3
    of_numpy = ((np.float32(0.1), float(np.float32(0.1))), (third, Fraction(*third.as_integer_ratio())), (0.1, 0.1))
    for value, meaning in (("1/3", Fraction(1, 3)), ("0.25", Fraction(1, 4)), (2, 2), (-1.0, -1), *of_numpy):
        found = method("scheme-i", lam=value).parameters["lam"]
        assert found == meaning
        assert type(found) is (float if isinstance(meaning, float) else Fraction)
    for value in (2, 2.0, np.float64(2), "2", Fraction(4, 2)):
        assert method("scheme-i", lam=value).label == "scheme-i(lam=2)"


def test_a_missing_trait_of_the_system_is_reported():
    lacking = {m.id for m in METHODS if m.lacks(LOTKA.system)}
    assert {"scheme-iv", "scheme-v", "avf"} <= lacking
    assert not {"symplectic-euler-q", "explicit-euler"} & lacking
    for id in lacking:
        with pytest.raises(InvalidInput, match=f"method '{id}' requires a system with the trait"):
            integrate(LOTKA, id, h=0.1, steps=3)


def test_h_t_end_and_steps_are_named():
    """Not by its place alone, so that h cannot be passed in the place of t_end."""
    for f in (pb.integrate, pb.integrate_ensemble, pb.section):
        found = inspect.signature(f).parameters
        assert {found[name].kind for name in ("h", "t_end", "steps")} == {inspect.Parameter.KEYWORD_ONLY}, f.__name__


@pytest.mark.parametrize("id", sorted(m.id for m in FIRST.values() if not m.lacks(KEPLER.system)))
def test_no_family_reports_a_radial_infall_as_ok(id):
    s = integrate(KEPLER, id, h=0.01, t_end=5.0, q0=[1.0, 0.0], p0=[0.0, 0.0])
    assert s.status in (COLLISION, NOT_CONVERGED, DIVERGED, INACCURATE, UNSTABLE), s.reason
    if id == "stormer-verlet":
        assert s.status == COLLISION
        assert integrate(problem("kepler", e=0.0), id, h=0.01, t_end=5.0).status == OK, "the control"


def test_progress_is_reported():
    told = []
    integrate(PENDULUM, "stormer-verlet", h=1e-3, steps=500_000, save_every=100_000, progress=told.append)
    assert told == sorted(set(told))
    assert (len(told) > 1, told[-1]) == (True, 500_000)


if __name__ == "__main__":
    print(json.dumps({"result": many()}))
