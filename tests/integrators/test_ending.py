"""What is reported at the end of a run, tested on made-up rows that lie just within and beyond each limit."""

from __future__ import annotations

import inspect
import pkgutil
from importlib import import_module

import numpy as np
import pytest

import phasebench as pb
from phasebench import integrators
from phasebench.integrators import Hamiltonian
from phasebench.integrators.outcome import describe_approach, describe_crossing, describe_escape, judge
from phasebench.integrators.systems.hamiltonian import PartitionedSystem

OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
PLANE = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - y")
NO_ENERGY = PartitionedSystem(q="q", p="p", dq=["p"], dp=["-q"])
#: Motion on a line with the potential -1/q.
WELL = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q", singular=["q"])
T = np.arange(100.0)


def rows(*states):
    """(Q, P), arrays (n, 1), of n states (q, p)."""
    return tuple(np.array(x, dtype=float)[:, None] for x in zip(*states, strict=True))


# -- the energy -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("p", "status"), [(1.0, "ok"), (1.001, "inaccurate")])
def test_energy_error_up_to_half_the_terms_is_ok(p, status):
    """H grows from 1/2 to 1, where the sizes of its terms add up to 1: this is accepted, a little more is not."""
    assert judge(OSCILLATOR, T, *rows((1, 0), (1, p))).status == status


def test_the_reported_time_is_that_of_the_first_bad_row():
    energy = np.where(T < 40, 1.0, np.where(T < 70, 3.0, 9.0))
    said = judge(OSCILLATOR, T, np.sqrt(energy)[:, None], np.zeros((100, 1))).reason
    assert "from t = 40 on" in said


def test_an_error_relative_to_the_mean_of_all_rows_is_dated():
    """The error exceeds its limit relative to the mean over all rows, not to the mean up to that row."""
    energy = np.r_[1.0, np.full(9, 100.0), np.full(990, 1.0)]
    t = np.arange(1000.0)
    assert "from t = 1 on" in judge(OSCILLATOR, t, np.sqrt(energy)[:, None], np.zeros((1000, 1))).reason


def is_bounded(error):
    """Whether the oscillator with these energy errors, at amplitude 1, is reported as an error that comes and goes."""
    amplitude = np.sqrt(2 * (0.5 + np.array(error)))
    amplitude[0] = 1.0
    return (
        "comes and goes" in judge(OSCILLATOR, np.arange(len(error)), amplitude[:, None], 0 * amplitude[:, None]).reason
    )


def test_bounded_and_growing_energy_errors_are_told_apart():
    waves = 3 * (1 - np.cos(np.arange(100.0)))
    assert is_bounded(waves)
    assert is_bounded(waves / 10), "whatever its size"
    assert not is_bounded(waves * np.linspace(1, 1.5, 100)), "it grows"
    assert not is_bounded(waves * np.linspace(1, 15, 100))
    assert not is_bounded(3 + waves), "it comes and does not go"
    assert not is_bounded(np.full(100, 3.0))
    assert not is_bounded(waves[:18]), "too few rows"


# -- growth -----------------------------------------------------------------------------------------------------------


def test_growth_with_conserved_energy_is_reported():
    """That a fall along y grows to 200 times the initial size is told, unless its energy was lost before that."""
    t = np.linspace(0, 20, 41)
    Q, P = np.stack([1 + 0 * t, t**2 / 2], 1), np.stack([0 * t, t], 1)
    said = describe_escape(PLANE, Q, P)
    assert "grown to 200:" in said
    assert "may escape" in said
    assert describe_escape(PLANE, Q[:6], P[:6]) == "", "it has not grown by much"
    assert describe_escape(PLANE, Q[:1], P[:1]) == "", "one row"
    lost = np.where(t[:, None] > 3, 3 * P, P)
    assert describe_escape(PLANE, Q, lost) == "", "the energy is lost before it has grown"
    sideways = np.stack([t**2 / 2, 1 + 0 * t], 1), np.stack([t, 0 * t], 1)
    along_x = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - x")
    assert "grown to 200:" in describe_escape(along_x, *sideways)
    assert "grown to 200:" in describe_escape(PLANE, 0 * Q + [0.001, 1] * Q, P), "what is small beside it has no say"


def test_growth_needs_an_energy_to_be_reported():
    assert describe_escape(NO_ENERGY, *rows((1, 0), (1000, 0))) == ""
    assert describe_approach(NO_ENERGY, *rows((1, 0), (1000, 0)), 0.1) is None


# -- singularities ----------------------------------------------------------------------------------------------------


def fall(q, H=-1.0):
    """The momentum at q of a fall towards the singularity of H = p^2 / 2 - 1 / q."""
    return -np.sqrt(2 * (H + 1 / q))


def test_a_last_step_longer_than_the_distance_is_reported():
    near, far = (0.01, fall(0.01)), (0.5, fall(0.5))
    assert "the step 1.41" in describe_approach(WELL, *rows(far, far, near), 0.1)
    assert "the distance 0.01 " in describe_approach(WELL, *rows(far, far, near), 0.1)
    assert describe_approach(WELL, *rows(near, near, far), 0.1) is None
    assert "the step 1.41" in describe_approach(WELL, *rows(near), 0.1), "it is the first one too"


#: A plane with a singularity at the origin; the tests pass it along x at the distance 0.1.
KEPLER = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - 1/sqrt(x**2 + y**2)", singular=["sqrt(x**2 + y**2)"])


def flyby(x, H):
    """(Q, P) of a motion along the line y = 0.1 with energies H."""
    x, H = np.broadcast_arrays(np.array(x, dtype=float), H)
    Q = np.stack([x, np.full(len(x), 0.1)], 1)
    return Q, np.stack([np.sqrt(2 * (H + 1 / np.hypot(*Q.T))), np.zeros(len(x))], 1)


X = [-5, -0.3, -0.1, 0.1, 5]


def test_an_encounter_is_reported_where_energy_is_lost():
    assert describe_crossing(KEPLER, T, *flyby(X, 1.0), 0.2) is None, "kept"
    assert describe_crossing(KEPLER, T, *flyby(X, np.array([1, 1, 1, 1, 0.95])), 0.2) is None, "less than a tenth"
    said = describe_crossing(KEPLER, T, *flyby(X, np.array([1, 1, 1, 1, 0.8])), 0.2)
    assert "near t = 1 " in said, "the first of several"
    assert "at distance 0.316 " in said
    assert f"length {0.2 * flyby(X, 1.0)[1][1, 0]:.3g} " in said
    after = np.array([1, 0.8, 0.8, 0.8, 0.8])
    assert "near t = 1 " in describe_crossing(KEPLER, T, *flyby(X, after), 0.2), "lost against the start"
    before = np.array([1, 5, 5, 1, 1])
    assert describe_crossing(KEPLER, T, *flyby([-5, -4, -4, -0.1, 0.1], before), 0.2) is None, "elsewhere"
    assert describe_crossing(KEPLER, T, *flyby(X, np.array([1, 1, 1, 1, 0.8])), 0.01) is None, "short steps"


def test_a_head_on_motion_is_reported_at_its_first_row():
    Q, P = flyby(X, 1.0)
    Q[2:4, 1] = 0.0
    assert "head-on after t = 2;" in describe_crossing(KEPLER, T, Q, P, 0.2)


# -- arguments of public functions ------------------------------------------------------------------------------------


def test_every_argument_may_be_named():
    """Those after a star are keyword-only, so that h cannot be passed in the place of t_end."""
    modules = [import_module(f"{integrators.__name__}.{m.name}") for m in pkgutil.iter_modules(integrators.__path__)]
    functions = [f for m in modules for f in vars(m).values() if inspect.isfunction(f) and f.__module__ == m.__name__]
    assert len(functions) > 40
    for f in functions:
        kinds = {p.kind for p in inspect.signature(f).parameters.values()}
        assert inspect.Parameter.POSITIONAL_ONLY not in kinds, f.__qualname__
    for f in (pb.integrate, pb.integrate_ensemble, pb.section):
        found = inspect.signature(f).parameters
        assert {found[name].kind for name in ("h", "t_end", "steps")} == {inspect.Parameter.KEYWORD_ONLY}, f.__name__
