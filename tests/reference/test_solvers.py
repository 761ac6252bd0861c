"""Reference solutions: exact ones, and certified Taylor runs."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.peers import PEERS
from phasebench.reference.solvers import taylor, translate
from phasebench.reference.solvers.exact import exact
from phasebench.reference.solvers.taylor import ReferenceFailed, reference

TIMES = np.array([i * 0.5 for i in range(21)])


def distance(found, solution) -> np.ndarray:
    """Distance in the maximum norm of a reference's decimal strings from an exact solution, array (rows,)."""
    with mpmath.workdps(45):
        text = np.hstack([found.q_text, found.p_text])
        rows = zip(text, np.hstack(solution), strict=True)
        return np.array([float(max(abs(mpmath.mpf(a) - b) for a, b in zip(x, y, strict=True))) for x, y in rows])


def bare(system, q0, p0):
    """Stand-in for a problem: a system with an initial state and nothing else."""
    return SimpleNamespace(system=system, q0=q0, p0=p0)


ROOMS = (
    "solvers.exact",
    "solvers.gauss",
    "solvers.taylor",
    "certificates.check",
    "certificates.stored",
    "peers.registry",
    "files",
)


def test_importing_the_references_loads_no_solver():
    """Nor do the records of peers load their packages."""
    imports = "\n".join(f"import phasebench.reference.{room}" for room in ROOMS)
    code = f"import sys\n{imports}\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    heavy = {"heyoka", "rebound", "scipy", "mpmath", "pandas", "matplotlib", "sympy", "numba", "phasebench.benchmarks"}
    assert "phasebench.reference.peers.rebound" in loaded
    assert not (heavy | {p.package for p in PEERS}) & {*loaded}


# -- exact solutions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("e", "t"), [(0.0, 3.0), (0.6, 7.0), (0.99, 1000.0)])
def test_kepler_conserves_its_invariants_to_all_digits(e, t):
    made = problem("kepler", e=e)
    q, p = exact(made, [0.0, t], 50)
    with mpmath.workdps(60):
        values = [
            [sp.lambdify((*made.system.q, *made.system.p), f, "mpmath")(*q[i], *p[i]) for i in (0, 1)]
            for f in (made.system.H, *made.invariants.values())
        ]
    assert max(abs(a - b) for a, b in values) < mpmath.mpf("1e-46")
    assert max(abs(q[1] - q[0])) > 0.01


def test_kepler_returns_after_one_period_only():
    made = problem("kepler", e=0.6)
    q, p = (np.array([mpmath.mpf(x) for x in v]) for v in (made.q0, made.p0))
    with mpmath.workdps(50):
        a = 1 / (2 / abs(q[0]) - p[1] ** 2)
        period = 2 * mpmath.pi * a ** mpmath.mpf("1.5")
    start, end = exact(made, [0.0, float(period)])[0]
    offset = float(period) - period
    assert abs(end[1] - start[1] - p[1] * offset) < 1e-30
    assert abs(a - 1) > 0  # rounding the initial data to doubles changes the semi-axis
    assert abs(a - 1) < 1e-15


def test_the_exact_solution_from_any_start_agrees_with_heyoka():
    made = problem("kepler")
    data = {"q0": (0.3, -1.1), "p0": (0.5, 0.4)}
    found = reference(made, TIMES, **data)
    assert (distance(found, exact(made, TIMES, **data)) <= 1.01 * found.uncertainty + 1e-23).all()


def test_problems_without_an_exact_solution():
    assert exact(problem("henon-heiles"), [1.0]) is None
    assert exact(problem("kepler"), [1.0], p0=(0.0, 3.0)) is None


def test_a_quarter_period_exchanges_position_and_momentum():
    made = problem("harmonic-oscillator", omega=1.3)
    q, p = exact(made, [np.pi / 2 / 1.3], q0=(0.5,), p0=(-0.7,))
    assert float(q[0, 0]) == pytest.approx(-0.7 / 1.3, abs=1e-15)
    assert float(p[0, 0]) == pytest.approx(-0.5 * 1.3, abs=1e-15)


def test_a_frequency_that_is_not_the_systems_is_refused():
    made = problem("harmonic-oscillator", omega=1.3)
    wrong = SimpleNamespace(id=made.id, system=made.system, q0=made.q0, p0=made.p0, parameters={"omega": 1.3 + 1e-12})
    with pytest.raises(ValueError, match="omega"):
        exact(wrong, [1.0])


# -- Taylor references ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "wrong"), [("harmonic-oscillator", {"omega": 1.3}), ("kepler", {"e": 0.6})])
def test_the_exact_solution_lies_within_the_uncertainty(name, wrong):
    made = problem(name, **wrong)
    found = reference(made, TIMES)
    assert (found.uncertainty[1:] > 0).all()
    assert found.uncertainty.max() < 1e-16
    assert (distance(found, exact(made, TIMES)) <= 1.01 * found.uncertainty + 1e-23).all()
    (key, value), *_ = wrong.items()
    off = exact(problem(name, **{key: value * (1 + 1e-13)}), TIMES)
    assert (distance(found, off)[4:] > 10 * found.uncertainty[4:]).all()


def test_uncertainty_grows_on_a_chaotic_orbit():
    found = reference(problem("henon-heiles:chaotic"), np.array([i * 10.0 for i in range(41)]))
    assert found.uncertainty[0] == 0
    assert found.uncertainty[1] < 1e-17
    assert found.uncertainty[-1] > 1e-9
    assert 50 < found.horizon() < 300
    assert 0 < found.horizon(1e-16) < found.horizon() < found.horizon(1e-8)
    assert found.horizon(0.0) == 0.0
    i = int(found.horizon() / 10)
    size = np.abs(np.hstack([found.q, found.p])).max(axis=1)
    assert found.uncertainty[i] <= 1e-13 * size[i]
    assert found.uncertainty[i + 1] > 1e-13 * size[i + 1]


def test_the_horizon_is_relative_to_the_state():
    t, uncertainty = np.array([1.0, 2.0]), np.array([5e-11, 5e-11])

    def horizon(size):
        q, p = np.full((2, 1), size), np.full((2, 1), -2 * size)
        return taylor.Reference(t, q, p, q.astype(str), p.astype(str), uncertainty, 0 * t).horizon(1e-13)

    assert horizon(1000.0) == 2.0
    assert horizon(0.1) == 0.0


def test_rows_are_the_rounded_long_double_run():
    found = reference(problem("henon-heiles:box"), TIMES, certify=False)
    assert np.isnan(found.uncertainty).all()
    assert np.isnan(found.horizon())
    long = np.vectorize(np.longdouble, otypes=[np.longdouble])(np.hstack([found.q_text, found.p_text]))
    assert (long.astype(float) == np.hstack([found.q, found.p])).all()
    lost = np.abs(long - np.hstack([found.q, found.p])).max(axis=1)
    assert (lost.astype(float) == found.rounding).all()
    assert 0 < found.rounding.max() < 1e-16


def test_lotka_volterra_conserves_its_invariant():
    made = problem("lotka-volterra:4-8")
    found = reference(made, [0.0, 5.0], certify=False)
    with mpmath.workdps(40):
        invariant = sp.lambdify((*made.system.q, *made.system.p), made.system.H, "mpmath")
        values = [
            invariant(mpmath.mpf(u[0]), mpmath.mpf(v[0])) for u, v in zip(found.q_text, found.p_text, strict=True)
        ]
    assert abs(values[1] - values[0]) < 1e-17


def third() -> SimpleNamespace:
    """The oscillator q'' = -q/3, whose coefficient is not a double."""
    return bare(Hamiltonian(q="q", p="p", H="p**2/2 + q**2/6"), (1.0,), (0.0,))


def third_error() -> float:
    """Error of the Taylor run of the oscillator q'' = -q/3 at t = 10."""
    found = reference(third(), [10.0], certify=False)
    with mpmath.workdps(40):
        w = 1 / mpmath.sqrt(3)
        return float(distance(found, ([[mpmath.cos(10 * w)]], [[-w * mpmath.sin(10 * w)]]))[0])


def test_rationals_are_exact_in_extended_precision(monkeypatch):
    assert third_error() < 1e-18
    monkeypatch.setattr(translate, "number", lambda e, fp: fp(float(e)))
    assert third_error() > 1e-17


def test_numbers_are_translated_exactly():
    import heyoka as hy

    quad = hy.real128
    assert translate.number(sp.Rational(1, 3), quad) == quad(1) / quad(3)
    assert translate.number(sp.Float(0.1), quad) == quad(0.1)
    assert translate.number(sp.Float(1e-30), np.longdouble) == np.longdouble(1e-30)
    assert translate.number(sp.Rational(2, 3), float) == 2 / 3
    assert abs(float(translate.number(sp.pi, quad) - quad("3.14159265358979323846264338327950288"))) < 1e-33


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


def test_high_powers_at_zero_are_not_nan():
    found = reference(bare(Hamiltonian(q="q", p="p", H="p**2/2 + q**6/6"), (0.0,), (1.0,)), [1.0], certify=False)
    assert 0.9 < found.q[0, 0] < 1


def test_an_untranslatable_function_is_named():
    with pytest.raises(InvalidInput, match="sign"):
        reference(bare(Hamiltonian(q="q", p="p", H="p**2/2 + abs(q)"), (1.0,), (0.0,)), [1.0])


def test_a_failed_run_names_the_time():
    runaway = bare(Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4"), (1.0,), (1.0,))
    with pytest.raises(ReferenceFailed, match=r"t = 1\.31"):
        reference(runaway, [1.0, 5.0])


def test_too_many_steps_are_a_failure(monkeypatch):
    monkeypatch.setattr(taylor, "STEP_LIMIT", 3)
    with pytest.raises(ReferenceFailed, match="3 steps"):
        reference(third(), [1000.0])


@pytest.mark.parametrize("times", [[], [-1.0, 1.0], [1.0, 1.0], [2.0, 1.0], [np.nan]])
def test_times_must_increase(times):
    with pytest.raises(ValueError, match="times"):
        reference(third(), times)


def test_the_start_is_a_row():
    found = reference(third(), [0.0])
    assert found.t.tolist() == [0.0]
    assert found.q.tolist() == [[1.0]]
