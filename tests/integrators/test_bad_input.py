"""Unusable input raises InvalidInput with a helpful message; trouble during a run ends it with a status."""

from __future__ import annotations

import json
import re
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import (
    COLLISION,
    DIVERGED,
    INACCURATE,
    NOT_CONVERGED,
    OK,
    TIMEOUT,
    UNSTABLE,
    integrate,
)
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.systems.formula import FUNCTIONS, parse
from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem
from support.one_of_each import kinds

PENDULUM, KEPLER = problem("pendulum"), problem("kepler")


# -- names ------------------------------------------------------------------------------------------------------------


def test_a_misspelt_method_suggests_the_nearest():
    for record in METHODS:
        wrong = record.id[:-1] + ("x" if record.id[-1] != "x" else "y")
        with pytest.raises(InvalidInput, match=rf"did you mean.*{re.escape(record.id)}"):
            method(wrong)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(InvalidInput, match=r"known are .*, avf, .* more \(`phasebench list`\)"):
        method("qqqqqqqqqq")
    with pytest.raises(InvalidInput, match=r"known are one, two$"):
        raise unknown_name("number", "qqqqqqqqqq", ["two", "one"])


def test_an_unknown_parameter_is_refused():
    for record in METHODS:
        with pytest.raises(InvalidInput, match=f"'{record.id}' has no parameter 'nonsense'"):
            method(record.id, nonsense=1)


@pytest.mark.parametrize("value", ["a third", float("nan"), float("inf"), None, [1], "1/0", "", True, "nan", 1j])
def test_a_parameter_that_is_not_a_number_is_refused(value):
    for record in METHODS:
        if "lam" in record.parameters:
            with pytest.raises(InvalidInput, match=r"lam is .*finite number"):
                record(lam=value)


@pytest.mark.parametrize("value", [0, -1, 7, 2.5, "two", None, float("nan"), float("inf"), True])
def test_an_invalid_order_is_refused(value):
    with pytest.raises(InvalidInput, match=r"for orders 1 to 6, not|the parameter order is .*an integer"):
        method("generating-function", order=value)


@pytest.mark.parametrize(("value", "meaning"), [("1/3", Fraction(1, 3)), ("0.25", Fraction(1, 4)), (2, 2), (-1.0, -1)])
def test_numbers_are_read_exactly(value, meaning):
    assert method("scheme-i", lam=value).parameters["lam"] == meaning


# -- the grid and the state -------------------------------------------------------------------------------------------

#: Further ones are refused in `test_request`, without `integrate`.
GRIDS = [
    ({"h": 0.0, "steps": 3}, "h is 0; it must be another number"),
    ({"h": -0.1, "steps": -3}, "steps is -3"),
    ({"h": float("inf"), "steps": 3}, "h is inf"),
    ({"h": 0.1, "t_end": 0.0}, "t_end is 0.0"),
    ({"h": 0.1, "t_end": -1.0, "t0": -1.0}, "t_end is -1.0, where the integration begins"),
    ({"h": 0.1, "t_end": float("nan")}, "t_end is nan"),
    ({"h": 0.1, "steps": float("nan")}, "steps is nan"),
    ({"h": 0.1, "steps": float("inf")}, "steps is inf"),
    ({}, "give the step h"),
    ({"h": 0.1, "steps": 3, "save_every": -1}, "save_every is -1"),
    ({"h": 0.1, "steps": "three"}, "steps is 'three'"),
]


@pytest.mark.parametrize(("arguments", "message"), GRIDS)
def test_an_invalid_grid_is_refused(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        integrate(PENDULUM, "implicit-midpoint", **arguments)


#: As for `GRIDS`.
STATES = [
    ({"q0": [1.0, 2.0]}, "q0 has 2 components; the problem has d = 1"),
    ({"p0": []}, "p0 has 0 components"),
    ({"q0": "one"}, "q0 is 'one'; it must be numbers"),
    ({"q0": [[1.0], [2.0]]}, "q0 has 2 components"),
    ({"q0": [None]}, r"q0 is \[nan\]; every component must be finite"),
]


@pytest.mark.parametrize(("arguments", "message"), STATES)
def test_an_invalid_state_is_refused(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        integrate(PENDULUM, "implicit-midpoint", h=0.1, steps=3, **arguments)


def test_a_singular_start_is_refused():
    with pytest.raises(InvalidInput, match="singularity"):
        integrate(KEPLER, "implicit-midpoint", h=0.1, steps=3, q0=[0.0, 0.0])
    with pytest.raises(InvalidInput, match="domain"):
        integrate(problem("lotka-volterra"), "implicit-midpoint", h=0.1, steps=3, q0=[-1.0])


LOTKA = problem("lotka-volterra")
ALL = kinds()


@pytest.mark.parametrize("label", [x for x, m in ALL.items() if m.lacks(LOTKA.system)])
def test_a_missing_trait_of_the_system_is_reported(label):
    with pytest.raises(InvalidInput, match=f"method '{ALL[label].id}' requires a system with the trait"):
        integrate(LOTKA, ALL[label], h=0.1, steps=3)


OTHERS = [x for x, m in ALL.items() if not m.lacks(LOTKA.system)]


@pytest.mark.parametrize("label", OTHERS)
def test_methods_that_fit_the_system_run(uncompiled, label):
    """Run without compilation, as a system is checked for what the method needs before anything is compiled."""
    assert uncompiled("integrators/test_bad_input.py")[label] == OK


def test_which_methods_do_not_fit_lotka_volterra():
    lacking = {m.id for m in METHODS if m.lacks(LOTKA.system)}
    assert {"scheme-iv", "scheme-v", "avf"} <= lacking
    assert not {"symplectic-euler-q", "explicit-euler"} & lacking


@pytest.mark.parametrize(
    ("H", "message"),
    [
        ("p**2 + z", "'z' is none of the variables q, p"),
        (sp.Symbol("p", real=True) ** 2 + sp.Symbol("z"), "z in the formula is none of the variables q, p"),
    ],
)
def test_a_hamiltonian_of_another_variable_is_refused(H, message):
    with pytest.raises(InvalidInput, match=message):
        Hamiltonian(q="q", p="p", H=H)


# -- trouble during a run ---------------------------------------------------------------------------------------------


def test_a_blow_up_is_a_divergence():
    falling = Hamiltonian(q="q", p="p", H="p**2/2 - q**4")
    s = integrate(falling, "stormer-verlet", h=0.05, steps=400, q0=[1.0], p0=[1.0])
    assert s.status == DIVERGED
    assert "smaller h" in s.reason
    assert np.isfinite(s.q).all()
    assert 1 < len(s.q) < 401
    assert s.counts["steps"] == len(s.q) - 1


@pytest.mark.parametrize("name", ["rk4", "scheme-v"])
def test_a_radial_infall_is_a_collision(name):
    s = integrate(KEPLER, name, h=0.01, t_end=5.0, q0=[1.0, 0.0], p0=[0.0, 0.0])
    assert s.status == COLLISION, s.reason
    assert s.reason


@pytest.mark.parametrize("label", [x for x, m in ALL.items() if not m.lacks(KEPLER.system)])
def test_no_method_reports_a_radial_infall_as_ok(label):
    s = integrate(KEPLER, ALL[label], h=0.01, t_end=5.0, q0=[1.0, 0.0], p0=[0.0, 0.0])
    assert s.status in (COLLISION, NOT_CONVERGED, DIVERGED, INACCURATE, UNSTABLE), s.reason


def test_control_a_circular_orbit_is_no_collision():
    assert integrate(problem("kepler", e=0.0), "stormer-verlet", h=0.01, t_end=5.0).status == OK


def test_an_unsolvable_stage_is_not_converged():
    # For lambda = 1 the stage equation x = h (p + x)^2 has no real solution if 4 h p > 1.
    system = PartitionedSystem(q="q", p="p", dq=["1"], dp=["p**2"])
    s = integrate(system, "implicit-euler", h=1.0, steps=3, q0=[0.0], p0=[1.0])
    assert s.status in (NOT_CONVERGED, DIVERGED)
    assert len(s.q) == 1
    assert "after step 0 of 3" in s.reason
    assert integrate(system, "implicit-euler", h=0.1, steps=1, q0=[0.0], p0=[1.0]).status == OK


def test_a_timeout_keeps_the_rows_reached():
    s = integrate(PENDULUM, "implicit-midpoint", h=1e-3, steps=10**9, save_every=200_000, timeout=0.3)
    assert s.status == TIMEOUT
    assert 1 < len(s.q) < 5001
    assert np.isfinite(s.q).all()
    assert s.t[-1] == pytest.approx(s.counts["steps"] * 1e-3)


def test_a_timeout_keeps_the_last_state():
    """With save_every=0 and a timeout the last row is the state at the time reached."""
    s = integrate(PENDULUM, "stormer-verlet", h=1e-6, steps=10**9, save_every=0, timeout=0.05)
    assert s.status == TIMEOUT
    n = s.counts["steps"]
    assert len(s.t) == 2
    assert s.t[1] == n * 1e-6
    again = integrate(PENDULUM, "stormer-verlet", h=1e-6, steps=n, save_every=0)
    assert np.abs(again.q[1] - s.q[1]) < 1e-12


def test_progress_is_reported():
    told = []
    integrate(PENDULUM, "stormer-verlet", h=1e-3, steps=500_000, save_every=100_000, progress=told.append)
    assert told == sorted(set(told))
    assert len(told) > 1
    assert told[-1] == 500_000


# -- formulas ---------------------------------------------------------------------------------------------------------

VARIABLES = {"q": sp.Symbol("q", real=True), "p": sp.Symbol("p", real=True)}
#: Besides those that `test_formula` has.
UNUSABLE = [
    "q := p",
    "q = p",
    "sin()",
    "q % p",
    "q // p",
    "q << 2",
    "~q",
    "2**100000",
    "q**9**9",
    "10**100**100",
    "(2**100)**100",
    "q**p",
    "2**q",
    "q/0",
    "q/(1-1)",
    "H",
    "   ",
    "q +",
    "(q",
    "q)",
    "q q",
    "1/1e999",
    "log(0)",
    "tan(pi/2)",
]


@pytest.mark.timeout(20)
@pytest.mark.parametrize("text", UNUSABLE)
def test_an_unusable_formula_is_refused(text):
    with pytest.raises(InvalidInput):
        parse(text, VARIABLES)


def test_a_refusal_names_the_error():
    for text, message in [
        ("x + q", "'x'"),
        ("sin(q, p)", "'sin'"),
        ("q.diff(q)", "brackets follow what is no function"),
    ]:
        with pytest.raises(InvalidInput, match=message):
            parse(text, VARIABLES)


@pytest.mark.parametrize(
    ("text", "expression"),
    [
        ("p**2/2 - cos(q)", VARIABLES["p"] ** 2 / 2 - sp.cos(VARIABLES["q"])),
        ("-q", -VARIABLES["q"]),
        ("+q", VARIABLES["q"]),
        ("ln(q)", sp.log(VARIABLES["q"])),
        ("1/3", sp.Rational(1, 3)),
        ("0.1", sp.Rational(0.1)),
        ("pi*e", sp.pi * sp.E),
        ("q**-2", VARIABLES["q"] ** -2),
        ("q**0.5", sp.sqrt(VARIABLES["q"])),
        ("q**(1/2)", sp.sqrt(VARIABLES["q"])),
        ("  q\n", VARIABLES["q"]),
        ("abs(q)", sp.Abs(VARIABLES["q"])),
        ("2*-q", -2 * VARIABLES["q"]),
    ],
)
def test_a_valid_formula_is_read(text, expression):
    assert parse(text, VARIABLES) == expression


def test_a_variable_hides_a_constant_of_the_same_name():
    e = sp.Symbol("e")
    assert parse("e", {"e": e}) == e


leaves = st.one_of(
    st.sampled_from([("q", VARIABLES["q"]), ("p", VARIABLES["p"])]),
    st.integers(0, 99).map(lambda n: (str(n), sp.Integer(n))),
    st.floats(0.0, 100.0).map(lambda x: (repr(x), sp.Rational(x))),
)


def _combine(children):
    """Strategy of (text, expression) pairs built from such pairs."""
    pair = st.tuples(children, children)
    return st.one_of(
        pair.map(lambda ab: (f"({ab[0][0]} + {ab[1][0]})", ab[0][1] + ab[1][1])),
        pair.map(lambda ab: (f"({ab[0][0]} - {ab[1][0]})", ab[0][1] - ab[1][1])),
        pair.map(lambda ab: (f"({ab[0][0]} * {ab[1][0]})", ab[0][1] * ab[1][1])),
        children.map(lambda a: (f"(-{a[0]})", -a[1])),
        st.tuples(children, st.integers(1, 5)).map(lambda an: (f"(({an[0][0]}) / {an[1]})", an[0][1] / an[1])),
        st.tuples(st.sampled_from(["q", "p"]), st.integers(2, 5)).map(
            lambda vn: (f"{vn[0]}**{vn[1]}", VARIABLES[vn[0]] ** vn[1])
        ),
        st.tuples(st.sampled_from(["sin", "cos", "exp", "tanh"]), children).map(
            lambda fa: (f"{fa[0]}({fa[1][0]})", getattr(sp, FUNCTIONS[fa[0]])(fa[1][1]))
        ),
    )


@settings(max_examples=200, deadline=None)
@given(st.recursive(leaves, _combine, max_leaves=12))
def test_a_random_formula_is_read_correctly(pair):
    text, expression = pair
    if expression.has(sp.zoo, sp.nan, sp.oo):
        return
    try:
        found = parse(text, VARIABLES)
    except InvalidInput as error:  # numbers that combine to more than a double holds
        assert "bits" in str(error) or "too large" in str(error)  # noqa: PT017
        return
    assert found == expression


if __name__ == "__main__":
    print(json.dumps({"result": {x: integrate(LOTKA, ALL[x], h=0.01, steps=3).status for x in OTHERS}}))
