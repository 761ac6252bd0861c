"""Unusable names, parameters and systems raise InvalidInput with a helpful message; trouble on the way is a status."""

from __future__ import annotations

import inspect
import re
from fractions import Fraction

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import (
    COLLISION,
    DIVERGED,
    INACCURATE,
    NOT_CONVERGED,
    OK,
    UNSTABLE,
    integrate,
)
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.names import aliases, normalize
from phasebench.integrators.registry import BY_ID, METHODS, method
from phasebench.reference.peers import BY_ID as PEERS
from support.one_of_each import FIRST

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
