"""Reference solutions: exact ones, certified Taylor runs, Gauss in long double, bodies of any mass, files."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.files import write_file
from phasebench.reference.peers import PEERS
from phasebench.reference.solvers import gauss, taylor, translate, watch
from phasebench.reference.solvers.attracting import Attracting
from phasebench.reference.solvers.exact import anomaly, exact
from phasebench.reference.solvers.taylor import ReferenceFailed, reference

TIMES = np.array([i * 0.5 for i in range(21)])
KEPLER = problem("kepler")


def distance(found, solution) -> np.ndarray:
    """Distance in the maximum norm of a reference's decimal strings from an exact solution, array (rows,)."""
    with mpmath.workdps(45):
        rows = zip(np.hstack([found.q_text, found.p_text]), np.hstack(solution), strict=True)
        return np.array([float(max(abs(mpmath.mpf(a) - b) for a, b in zip(x, y, strict=True))) for x, y in rows])


def bare(H, q0=(1.0,), p0=(0.0,)):
    """Stand-in for a problem: a system of one degree of freedom with an initial state and nothing else."""
    return SimpleNamespace(system=Hamiltonian(q="q", p="p", H=H), q0=q0, p0=p0)


#: The oscillator q'' = -q/3, whose coefficient is not a double.
THIRD = bare("p**2/2 + q**2/6")
MODULES = ("solvers.exact", "solvers.gauss", "certificates.check", "certificates.stored", "peers.registry", "files")


def test_importing_the_references_loads_no_solver():
    """Nor do the records of peers load their packages."""
    code = "\n".join(["import sys", *(f"import phasebench.reference.{m}" for m in MODULES), "print(*sys.modules)"])
    loaded = {*subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()}
    heavy = {"heyoka", "rebound", "scipy", "mpmath", "pandas", "matplotlib", "sympy", "numba", "phasebench.benchmarks"}
    assert "phasebench.reference.peers.rebound" in loaded
    assert not (heavy | {p.package for p in PEERS}) & loaded


def test_a_file_that_cannot_be_replaced_stays_and_leaves_nothing_beside_it(tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    path = tmp_path / "a.txt"
    write_file(path, "old")
    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_file(path, "new")
    monkeypatch.undo()
    assert ([*tmp_path.iterdir()], path.read_text()) == ([path], "old")
    write_file(path, b"new")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("new", 0o644)


# -- exact solutions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ecosine", "esine"), [(0.0, 0.0), (0.3, -0.4), (0.999999, 0.0), (0.0, 0.99)])
@pytest.mark.parametrize("M", ["-7", "1e-9", "3.14", "250"])
def test_keplers_equation_is_solved_to_all_digits(M, ecosine, esine):
    with mpmath.workdps(60):
        M, ecosine, esine = mpmath.mpf(M), mpmath.mpf(ecosine), mpmath.mpf(esine)
        x = anomaly(M, ecosine, esine)
        assert abs(x - ecosine * mpmath.sin(x) + esine * (1 - mpmath.cos(x)) - M) < mpmath.mpf("1e-54") * (1 + abs(M))


def test_the_oscillator_has_its_own_frequency():
    made = problem("harmonic-oscillator", omega=1.3)
    q, p = exact(made, [np.pi / 2 / 1.3], q0=(0.5,), p0=(-0.7,))
    assert float(q[0, 0]) == pytest.approx(-0.7 / 1.3, abs=1e-15)
    assert float(p[0, 0]) == pytest.approx(-0.5 * 1.3, abs=1e-15)
    wrong = SimpleNamespace(id=made.id, system=made.system, q0=made.q0, p0=made.p0, parameters={"omega": 1.3 + 1e-12})
    with pytest.raises(ValueError, match="omega"):
        exact(wrong, [1.0])
    assert exact(problem("henon-heiles"), [1.0]) is None
    assert exact(KEPLER, [1.0], p0=(0.0, 3.0)) is None


# -- Taylor references ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "parameters", "start"),
    [
        ("harmonic-oscillator", {"omega": 1.3}, {}),
        ("kepler", {"e": 0.6}, {}),
        ("kepler", {}, {"q0": (0.3, -1.1), "p0": (0.5, 0.4)}),
    ],
)
def test_the_exact_solution_lies_within_the_uncertainty(name, parameters, start):
    made = problem(name, **parameters)
    found = reference(made, TIMES, **start)
    assert (found.uncertainty[1:] > 0).all()
    assert found.uncertainty.max() < 1e-15
    assert (distance(found, exact(made, TIMES, **start)) <= 1.01 * found.uncertainty + 1e-23).all()
    for key, value in parameters.items():
        off = exact(problem(name, **{key: value * (1 + 1e-13)}), TIMES)
        assert (distance(found, off)[4:] > 10 * found.uncertainty[4:]).all()


def test_rows_are_the_rounded_long_double_run():
    found = reference(problem("henon-heiles:box"), TIMES, certify=False)
    assert np.isnan(found.uncertainty).all()
    doubles = np.hstack([found.q, found.p])
    long = np.vectorize(np.longdouble, otypes=[np.longdouble])(np.hstack([found.q_text, found.p_text]))
    assert (long.astype(float) == doubles).all()
    assert (np.abs(long - doubles).max(axis=1).astype(float) == found.rounding).all()
    assert 0 < found.rounding.max() < 1e-16


def test_rationals_are_exact_in_extended_precision(monkeypatch):
    def error():
        with mpmath.workdps(40):
            w = 1 / mpmath.sqrt(3)
            true = [[mpmath.cos(10 * w)]], [[-w * mpmath.sin(10 * w)]]
            return float(distance(reference(THIRD, [10.0], certify=False), true)[0])

    assert error() < 1e-18
    monkeypatch.setattr(translate, "number", lambda e, fp: fp(float(e)))
    assert error() > 1e-17


@pytest.mark.parametrize("bits", [113, 150, 300])
def test_numbers_of_many_bits_are_exact(bits):
    """The double nearest 1/3, the rational 1/3 and pi, against mpmath."""
    number = taylor.Bits(bits)
    assert bits * np.log10(2) + 5 < number.digits < bits * np.log10(2) + 15
    with mpmath.workprec(bits + 40):
        third = mpmath.mpf(1) / 3
        for e, true in ((sp.Rational(1, 3), third), (sp.Float(1 / 3), mpmath.mpf(1 / 3)), (sp.pi, +mpmath.pi)):
            off = abs(mpmath.mpf(str(translate.number(e, number))) - true)
            assert off <= 8 * true * mpmath.mpf(2) ** -bits


@pytest.mark.parametrize(
    "formula",
    [
        "q**5",
        "1/q**3",
        "(q**2 + p**2)**(-3/2)",
        "(q + p)**(5/2)",
        "sqrt(q)*p**7",
        "q**(1/3)",
        "sin(q)*cos(p) - exp(-q*p)/3 + log(q)",
        "tanh(q) + atan(p) + asin(q/2) + sinh(p)*cosh(q) + tan(q) + acos(q/3)",
        "0.1*q + pi",
        "2**q",
    ],
)
def test_a_translated_formula_has_the_same_value(formula):
    import heyoka as hy

    q, p = sp.symbols("q p", positive=True)
    e = sp.sympify(formula, locals={"q": q, "p": p})
    x, y = hy.make_vars("x", "y")
    f = hy.cfunc([translate.translate(e, {q: x, p: y}, float)], [x, y])
    assert f([0.7, 1.3])[0] == pytest.approx(float(e.subs({q: 0.7, p: 1.3})), rel=1e-14)


def test_high_powers_at_zero_are_not_nan_and_an_untranslatable_function_is_named():
    assert 0.9 < reference(bare("p**2/2 + q**6/6", (0.0,), (1.0,)), [1.0], certify=False).q[0, 0] < 1
    with pytest.raises(InvalidInput, match="sign"):
        reference(bare("p**2/2 + abs(q)"), [1.0])


def test_a_failed_run_names_the_time(monkeypatch):
    with pytest.raises(ReferenceFailed, match=r"t = 1\.31"):
        reference(bare("p**2/2 - q**4/4", (1.0,), (1.0,)), [1.0, 5.0])
    monkeypatch.setattr(taylor, "STEP_LIMIT", 3)
    with pytest.raises(ReferenceFailed, match="3 steps"):
        reference(THIRD, [1000.0])


def test_times_must_increase_and_the_start_is_a_row():
    for times in ([], [-1.0, 1.0], [1.0, 1.0], [2.0, 1.0], [np.nan]):
        with pytest.raises(ValueError, match="times"):
            reference(THIRD, times)
    found = reference(THIRD, [0.0])
    assert (found.t.tolist(), found.q.tolist()) == ([0.0], [[1.0]])


def test_bodies_of_any_mass_are_followed_again_and_again():
    """Two bodies about their centre on circles, then a test particle about the first, then the two again."""
    flow, times = Attracting(2, 1.0), np.array([0.0, 0.7, 1.9])
    x, v = np.array([-0.25, 0.0, 0.0, 0.75, 0.0, 0.0]), np.array([0.0, -0.25, 0.0, 0.0, 0.75, 0.0])
    for masses, others in (((0.75, 0.25), 1.0), ((1.0, 0.0), 0.0), ((0.75, 0.25), 1.0)):
        places, velocities, _ = flow.rows(masses, x, v * others + (1 - others) * np.array([0, 0, 0, 0, 1.0, 0]), times)
        apart, speed = places[:, 3:] - places[:, :3], velocities[:, 3:] - velocities[:, :3]
        np.testing.assert_allclose(apart, np.c_[np.cos(times), np.sin(times), 0 * times], atol=1e-14)
        np.testing.assert_allclose(speed, np.c_[-np.sin(times), np.cos(times), 0 * times], atol=1e-14)


# -- progress and time limits ------------------------------------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch):
    """The list of one number that replaces the clock, in seconds."""
    now = [0.0]
    monkeypatch.setattr(watch.time, "perf_counter", lambda: now[0])
    return now


#: What happens: limit, (seconds, run, t, t_end)...; the last of them stops the run, or none.
GOES_ON = {
    "more than 3 times the limit, but the rate is not yet reliable": (100, (4, "run", 1.0, 100), (8, "run", 1.2, 100)),
    "the limit itself is in time": (100, (4, "run", 4, 100), (50, "run", 50, 100), (100, "run", 99, 100)),
    "each run has its own rate": (100, (0, "a", 0, 1), (50, "a", 1, 1), (50, "b", 1, 20), (60, "b", 6, 20)),
    "a run that is started again has no rate yet": (
        *(100, (0, "a", 0.0, 20), (50, "a", 19, 20), (60, "a", 0.01, 20)),
        (60, "a", 0.02, 20),
    ),
}
STOPS = {
    "without hope": (100, (4, "run", 1.0, 100), (10, "run", 2.0, 100)),
    "after the limit": (100, (0, "run", 0, 100), (20, "run", 20, 100), (99, "run", 99, 100), (101, "run", 99.5, 100)),
}


@pytest.mark.parametrize(("what", "stops"), [*((x, False) for x in GOES_ON), *((x, True) for x in STOPS)])
def test_a_run_ends_after_its_time_or_without_hope(clock, what, stops):
    limit, *reports, last = (GOES_ON | STOPS)[what]
    with watch.watching(limit, lambda told: None):
        for clock[0], *report in reports:
            watch.report_time(*report)
        clock[0] = last[0]
        with pytest.raises(watch.TooLong, match="the run came to t = ") if stops else contextlib.nullcontext():
            watch.report_time(*last[1:])


def test_progress_is_reported_at_a_readable_rate_and_only_while_watched(clock):
    told = []
    with watch.watching(100.0, told.append):
        for k in range(100):
            clock[0] = 1 + 0.01 * k
            watch.report_time("run", k / 10, 1e3)
    assert told[0] == "run: t = 0 of 1000"
    assert 4 <= len(told) <= 6
    clock[0] = 1e9
    watch.report_time("run", 1.0, 2.0)
    assert not watch.is_watched()


def test_watching_does_not_change_the_solvers():
    made, told = problem("harmonic-oscillator"), []
    args = made.system, made.q0, made.p0
    plain = taylor.states(args[0], float, *args[1:], [10.0, 20.0])
    with watch.watching(60.0, told.append):
        assert (taylor.states(args[0], float, *args[1:], [10.0, 20.0]) == plain).all()
        gauss.run(*args, [0.5, 1.0], [1.0])
    assert told[0].startswith("float run: t = ")
    for run in (lambda: taylor.states(args[0], float, *args[1:], [1e9]), lambda: gauss.run(*args, [0.5, 1.0], [1.0])):
        with watch.watching(1e-9, told.append), pytest.raises(watch.TooLong):
            run()


# -- the Gauss method in long double ----------------------------------------------------------------------------------


LONG = np.longdouble
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
PENDULUM = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


def text(x) -> mpmath.mpf:
    """A long double as an exact mpmath number."""
    return mpmath.mpf(float(x)) + mpmath.mpf(float(x - LONG(float(x))))


def test_coefficients_are_exact_to_thirty_digits():
    """The simplifying assumptions B(16) and C(8), for coefficients stored as sums of two long doubles."""
    rule = gauss.tableau()
    with mpmath.workdps(40):
        b = [text(x) + text(y) for x, y in zip(rule.b, rule.b_rest, strict=True)]
        A = [[text(x) + text(y) for x, y in zip(*rows, strict=True)] for rows in zip(rule.A, rule.A_rest, strict=True)]
        c = [sum(row, mpmath.mpf(0)) for row in A]
        for k in range(1, 17):
            assert abs(sum(x * y ** (k - 1) for x, y in zip(b, c, strict=True)) - mpmath.mpf(1) / k) < 1e-30
        assert abs(sum(x * y**16 for x, y in zip(b, c, strict=True)) - mpmath.mpf(1) / 17) > 1e-12, "the order is 16"
        for k in range(1, 9):
            for row, x in zip(A, c, strict=True):
                assert abs(sum(a * y ** (k - 1) for a, y in zip(row, c, strict=True)) - x**k / k) < 1e-30
        assert max(abs(x - float(y)) for x, y in zip(rule.c, c, strict=True)) < 1e-16
    assert 1e-21 < np.abs(rule.b_rest).max() < 1e-19, "what is left of a number in long double"


@pytest.mark.parametrize("marks", [[], [0.5, 0.6, 1.7, 2.9, 7.0]])
def test_the_circle_is_exact_to_long_double(marks):
    rows = gauss.run(OSCILLATOR, (1.0,), (0.0,), sorted({*marks, *np.arange(0.25, 3.0, 0.25)}), [2.0, 3.0])
    with mpmath.workdps(30):
        for row, t in zip(rows, (2, 3), strict=True):
            assert abs(text(row[0]) - mpmath.cos(t)) < 5e-19
            assert abs(text(row[1]) + mpmath.sin(t)) < 5e-19


@pytest.mark.processor
def test_constants_are_not_rounded_to_doubles():
    """2**(1/2) and 1/3 as doubles would be an error of 1e-16."""
    made = problem("quadrupole-boson:benchmark")
    long, quad = taylor.extended_types()
    ends = taylor.step_ends(made.system, long, made.q0, made.p0, 2.0)
    found = gauss.run(made.system, made.q0, made.p0, [x / 2 for x in ends] + ends, [2.0])[0]
    truth = taylor.states(made.system, quad, made.q0, made.p0, [2.0])[0]
    assert max(abs(float(quad(a) - b)) for a, b in zip(found, truth, strict=True)) < 3e-18 * max(map(abs, found))


def test_unsolvable_stages_are_a_failure():
    with pytest.raises(taylor.ReferenceFailed, match=r"after t = 0\.5; its steps are too large"):
        gauss.run(PENDULUM, (1.5,), (0.3,), [0.25, 0.5], [90.0])


# -- kinks ------------------------------------------------------------------------------------------------------------


def kinked(H, q0, p0, t, *marks):
    """The state at time t by Gauss's method, in steps of 0.1 that also end at the ``marks``."""
    made = from_formula(H, q0, p0, {})
    (row,) = gauss.run(made.system, made.q0, made.p0, sorted({*np.arange(0.1, t, 0.1), *marks}), [t])
    return row.astype(float)


@pytest.mark.parametrize(
    ("H", "q0", "p0", "t", "exact"),
    [
        ("p**2/2 + abs(q)", (0.0,), (1.0,), 4.5, (0.375, 0.5)),  # from a kink
        ("p**2/2 + abs(q)", (2.5,), (-2.0,), 1.0, (0.0, -3.0)),  # to a kink, where a step ends
        ("p**2/2 + abs(q)", (2.5,), (-2.0,), 2.0, (-2.5, -2.0)),
        ("p**2/2 + abs(abs(q) - 1)", (3.0,), (0.0,), 7 - 2 * 2**0.5, (-2.5, -1.0)),  # one in another
        ("(p1**2 + p2**2)/2 + abs(q1) + abs(q2)", (0.0, 0.0), (1.0, 1.0), 4.5, (0.375, 0.375, 0.5, 0.5)),  # at once
        ("(p1**2 + p2**2)/2 + abs(q1) + abs(q2)", (0.0, 0.0), (1.0, 0.0), 4.5, (0.375, 0.0, 0.5, 0.0)),  # along one
    ],
)
def test_kinks_in_every_place(H, q0, p0, t, exact):
    assert kinked(H, q0, p0, t, 1.0) == pytest.approx(exact, abs=1e-14)


def test_control_steps_across_kinks_are_inaccurate(monkeypatch):
    right = gauss.right_hand_side

    def across(system):
        F, _ = right(system)
        return lambda Y, signs: F(Y, np.sign(Y[:1]))[:2], 0

    monkeypatch.setattr(gauss, "right_hand_side", across)
    assert np.abs(kinked("p**2/2 + abs(q)", (2.5,), (-2.0,), 1.95) - (-2.54875, -2.05)).max() > 1e-4
