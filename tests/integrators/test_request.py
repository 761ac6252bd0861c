"""Arguments of a run, without running it: the grid of times, the rows, the start, and messages for invalid ones."""

from __future__ import annotations

import json
import re
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from phasebench.integrators import Hamiltonian, driver, request
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import MOST, check_timeout, grid, initial, spacing

PLANE = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2 + x**2 + y**2)/2 + x*y**2")
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")


class StartedProblem:
    """Stand-in for a problem with one initial state."""

    system, q0, p0 = PLANE, (1.0, 2.0), (3.0, 4.0)


def expect_refusal(message: str):
    """Context that expects InvalidInput with this message."""
    return pytest.raises(InvalidInput, match=message)


# -- the grid of times ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "made"),
    [
        ((0.25, 10.0, None), (0.25, 40)),
        ((0.25, None, 7), (0.25, 7)),
        ((None, 10.0, 4), (2.5, 4)),
        ((2.5, 10.0, 4), (2.5, 4)),
        ((2.5 * (1 + 1e-10), 10.0, 4), (2.5, 4)),
        ((0.331, 10.0, None), (10 / 30, 30)),  # 0.7 % longer
        ((5.0, 2.0, None), (2.0, 1)),
        ((1, 3, None), (1.0, 3)),
        ((None, 3, 1.0), (3.0, 1)),
        ((0.1, 1.0, None), (0.1, 10)),
        ((0.1, 0.3, None), (0.1, 3)),  # h as given, although 3 h differs from 0.3 in the last bit
        ((1.0, None, MOST), (1.0, 10**13)),
        ((1.0, MOST, None), (1.0, 10**13)),
    ],
)
def test_two_of_h_t_end_and_steps_make_a_grid(asked, made):
    h, steps = grid(*asked)
    assert (h, steps) == made
    assert (type(h), type(steps)) == (float, int)


def test_a_step_is_lengthened_by_one_percent_at_most():
    for h in np.geomspace(0.011, 3.0, 200).tolist():
        try:
            made, steps = grid(h, 10.0)
        except InvalidInput as error:
            nearest = re.search(r"that do are (\S+) \(.*\) and (\S+) \(", str(error)).groups()
            longer, shorter = map(float, nearest)
            assert shorter < h < 1.01 * h < longer
            for fits in (longer, shorter):
                assert grid(fits, 10.0)[0] == pytest.approx(fits, rel=1e-12)
        else:
            assert steps * made == pytest.approx(10.0, rel=1e-12)
            assert made <= 1.01 * h * (1 + 1e-12)
            assert steps == max(1, round(10.0 / h))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ((0.5, 10.0, 4), r"steps times h is 2\.0, not t_end = 10\.0"),
        ((2.5 * (1 + 1e-8), 10.0, 4), "steps times h"),
        ((2.5 * (1 - 1e-8), 10.0, 4), "steps times h"),
        ((2.9, 6.5, None), r"are 3\.25 \(2 steps\) and 2\.1666666666666665 \(3 steps\)"),
        ((6.0, 6.5, None), r"are 6\.5 \(1 step\) and 3\.25 \(2 steps\)"),
        ((None, None, 4), "give the step h"),
        ((None, 1.0, None), "give the step h"),
        ((0.1, None, None), "where does the integration end"),
        ((0.1, None, 2 * MOST), r"steps is 2e\+13; the most is 1e13"),
        ((0.1, MOST, None), r"t_end/h asks for 1e\+14 steps"),
        ((0.1, None, 2.5), "steps is 2.5"),
        ((True, 1.0, None), "h is True"),
        ((0.1, 1.0, False), "steps is False"),
        ((float("nan"), 1.0, None), "h is nan"),
        ((0.1, float("inf"), None), "t_end is inf"),
        ((10**5000, 1.0, None), "h is an integer beyond the doubles"),
        ((0.1, None, 10**400), "steps is an integer beyond the doubles"),
        ((0, 1.0, None), "h is 0;"),
        ((0.1, None, 0), "steps is 0;"),
        (("0.1", 1.0, None), "h is '0.1'"),
    ],
)
def test_an_invalid_grid_is_refused(asked, message):
    with expect_refusal(message):
        grid(*asked)


# -- rows -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("asked", "every"), [(1, 1), (4, 4), (9, 9), (30, 9), (0, 9), (2.0, 2)])
def test_row_spacing_is_at_most_the_run(asked, every):
    made = spacing(asked, 9)
    assert (made, type(made)) == (every, int)


@pytest.mark.parametrize("asked", [-1, 0.5, 1.5, True, False, None, "2", float("nan"), float("inf"), 10**400])
def test_an_invalid_row_spacing_is_refused(asked):
    with expect_refusal("save_every is .*positive integer, or 0"):
        spacing(asked, 9)


def test_rows_are_multiples_of_the_spacing_and_the_last():
    asked = {"h": 0.1, "steps": 10}
    assert request.request(StartedProblem(), **asked, save_every=3).step_numbers == [0, 3, 6, 9, 10]
    assert request.request(StartedProblem(), **asked, save_every=5).step_numbers == [0, 5, 10]
    assert request.request(StartedProblem(), **asked, save_every=0).step_numbers == [0, 10]
    assert request.request(StartedProblem(), **asked).every == 1


def test_the_number_of_rows_is_limited(monkeypatch):
    """The numbers of all rows are limited: with d = 2, eleven rows are 22 numbers."""
    monkeypatch.setattr(request, "LARGEST", 22)
    assert request.request(StartedProblem(), h=0.1, steps=10).steps == 10
    assert request.request(StartedProblem(), h=0.1, steps=30, save_every=3).every == 3
    with expect_refusal("12 rows of d = 2"):
        request.request(StartedProblem(), h=0.1, steps=11)
    with expect_refusal("12 rows of d = 2"):
        request.request(StartedProblem(), h=0.1, steps=31, save_every=3)


# -- time -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("timeout", [None, 1, 0.5, Fraction(1, 3), float("inf")])
def test_a_positive_time_limit_passes(timeout):
    check_timeout(timeout)


@pytest.mark.parametrize("timeout", [0, 0.0, -1, True, False, "1", float("nan"), [1], 10**400])
def test_an_invalid_time_limit_is_refused(timeout):
    with expect_refusal("timeout is .*positive number of seconds"):
        check_timeout(timeout)


# -- the initial state ------------------------------------------------------------------------------------------------


def test_the_initial_state_defaults_to_the_problems():
    system, q, p = initial(StartedProblem())
    assert system is PLANE
    assert (q.tolist(), p.tolist()) == ([1, 2], [3, 4])
    _, q, p = initial(StartedProblem(), p0=[5, 6])
    assert (q.tolist(), p.tolist(), p.dtype) == ([1, 2], [5, 6], float)
    assert initial(PLANE, (0, 0), [[1], [1]])[2].tolist() == [1, 1]


def test_an_exact_state_is_left_unchanged():
    third = [Fraction(1, 3), Fraction(2, 3)]
    _, q, p = initial(PLANE, third, third, exact=True)
    assert q is third
    assert p is third


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ((PLANE, None, [0, 0]), "give q0"),
        ((PLANE, [0, 0], None), "give p0"),
        ((PLANE, [0], [0, 0]), "q0 has 1 components; the problem has d = 2"),
        ((PLANE, [0, 0], [0, 0, 0]), "p0 has 3 components"),
        ((PLANE, [0, "a"], [0, 0]), "q0 is .*must be numbers"),
        ((PLANE, [0, 1j], [0, 0]), "q0 is .*must be numbers"),
        ((PLANE, [0, 0], [0, float("nan")]), r"p0 is \[0\.0, nan\]; every component"),
        ((PLANE, [0, float("inf")], [0, 0]), "every component"),
        ((PLANE, [1e200, 0], [0, 0]), "the energy of the initial state is inf"),
        (("plane", [0, 0], [0, 0]), "the problem is 'plane'"),
    ],
)
def test_an_invalid_state_is_refused(asked, message):
    with expect_refusal(message):
        initial(*asked)


# -- runs -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "beyond"), [(1e150, 1.001e150), (1e-150, 0.999e-150)])
def test_the_size_of_a_state_is_limited(size, beyond):
    assert initial(OSCILLATOR, [size], [0.0])[1] == size
    with expect_refusal("choose units"):
        initial(OSCILLATOR, [beyond], [0.0])


def test_a_stopped_run_has_equally_many_rows_of_each():
    s = integrate(OSCILLATOR, "explicit-euler", h=1e3, steps=400, q0=[1.0], p0=[0.0])
    assert s.status == driver.DIVERGED
    assert 1 < len(s.t) == len(s.q) == len(s.p) == 1 + len(s.parameter) < 400


def test_a_warm_run_returns_the_end_state():
    q, p = driver.warm(StartedProblem(), "stormer-verlet", h=0.01, steps=5)()
    s = integrate(StartedProblem(), "stormer-verlet", h=0.01, steps=5)
    assert np.array_equal([q, p], [s.q[-1], s.p[-1]])
    asked = {"problem": StartedProblem(), "method": "stormer-verlet", "h": 0.01, "steps": 5}
    assert np.array_equal(integrate(**asked).q, s.q), "every argument may be named"
    assert np.array_equal(driver.warm(**asked)()[0], q)


def exact_position(q: Fraction, p: Fraction, h: Fraction, steps: int) -> Fraction:
    """Exact q of the oscillator after Stormer-Verlet steps."""
    for _ in range(steps):
        p -= h * q / 2
        q += h * p
        p -= h * q / 2
    return q


def many() -> dict:
    """Multiprecision runs: {name: (rows, steps, end time, error, status, reason)}."""
    end = exact_position(Fraction(1, 3), Fraction(1, 3), Fraction(1, 10), 7)
    third = [Fraction(1, 3)]
    runs = {
        "steps": {"h": Fraction(1, 10), "steps": 7},
        "span and steps": {"t_end": Fraction(7, 10), "steps": 7},
        "span": {"h": Fraction(1, 10), "t_end": Fraction(7, 10)},
        "a step that nearly divides it": {"h": 0.1, "t_end": Fraction(7, 10)},
        "later start": {"h": Fraction(1, 10), "t0": -2, "t_end": Fraction(-13, 10)},
        "later span": {"t0": -2, "t_end": Fraction(-13, 10), "steps": 7},
        "rows": {"h": Fraction(1, 10), "steps": 7, "save_every": 3},
    }
    found = {}
    with precision(40):
        runs["mpmath"] = {"h": mpmath.mpf(1) / 10, "t_end": mpmath.mpf(7) / 10}
        for name, asked in runs.items():
            s = integrate(OSCILLATOR, "stormer-verlet", q0=third, p0=third, arithmetic=MULTIPRECISION, **asked)
            lost = abs(3 * s.q[0, 0] - 1) + abs(10 * s.h - 1)
            lost += abs(s.q[-1, 0] - to_number(end, MULTIPRECISION))
            found[name] = [len(s.t), s.counts["steps"], float(s.t[-1] - s.t[0]), float(lost), s.status, s.reason]
        for asked, why in REFUSED:
            with expect_refusal(why):
                integrate(OSCILLATOR, "stormer-verlet", q0=third, p0=third, arithmetic=MULTIPRECISION, **asked)
    return found


#: Arguments that a run in doubles refuses too, and how.
REFUSED = (
    ({"h": Fraction(1, 10)}, "give t_end or steps"),
    ({"t_end": 1}, "give the step h"),
    ({"h": 0, "steps": 3}, "h is 0"),
    ({"h": Fraction(3, 10), "t_end": 1}, "does not divide"),
)


@pytest.mark.parametrize(("asked", "why"), REFUSED)
def test_doubles_refuse_what_multiprecision_refuses(asked, why):
    with expect_refusal(why):
        integrate(OSCILLATOR, "stormer-verlet", q0=[1.0], p0=[0.0], **asked)


def test_multiprecision_uses_the_same_grids_exactly(uncompiled):
    found = uncompiled("integrators/test_request.py")
    for name, (rows, steps, end, lost, *status) in found.items():
        assert (rows, steps, end) == (4 if name == "rows" else 8, 7, pytest.approx(0.7, rel=1e-15)), name
        assert lost < 1e-38, name
        assert status == ["ok", ""], name


if __name__ == "__main__":
    print(json.dumps({"result": many()}))
