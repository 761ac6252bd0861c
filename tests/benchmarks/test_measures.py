"""The printed columns, the exhaustive scan, timing and the C loop."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from phasebench.benchmarks.experiments.printed import printed, riddle
from phasebench.benchmarks.measure import c_loop, timing
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from phasebench.integrators.registry import method

# -- the printed columns -----------------------------------------------------------------------------------------------


def test_unit_of_a_printed_entry():
    assert printed.unit("4.31E-03") == pytest.approx(1e-5)
    assert printed.unit("9.99E-08") == pytest.approx(1e-10)
    for column in printed.PRINTED.values():
        for text in column:
            mantissa, exponent = text.split("E")
            assert len(mantissa) == 4
            assert printed.unit(text) == pytest.approx(10.0 ** (int(exponent) - 2))


def test_every_printed_column_has_four_falling_entries():
    for column in printed.PRINTED.values():
        assert len(column) == len(printed.STEPS) - 1 == 4
        assert all(1.8 < float(a) / float(b) < 4.3 for a, b in pairwise(column))


def test_units_and_orders_of_a_column():
    rows = list(printed.measured("scheme-ii", "1/3"))
    ends = []
    for h in printed.STEPS:
        s = integrate(problem("henon-heiles:chaotic"), method("scheme-ii", lam="1/3"), h=h, t_end=1.0)
        ends.append(np.concatenate([s.q[-1], s.p[-1]]))
    for k, (row, text) in enumerate(zip(rows, ("2.35E-05", "5.87E-06", "1.47E-06", "3.67E-07"), strict=True)):
        difference = np.abs(ends[k + 1] - ends[k]).max()
        assert (row["printed"], row["h"]) == (text, 0.01 / 2**k)
        assert row["refinement_difference"] == pytest.approx(difference, rel=1e-9)
        last_digit = 10.0 ** (int(text[-3:]) - 2)
        assert row["units"] == pytest.approx(abs(difference - float(text)) / last_digit, rel=1e-6)
        assert row["units"] <= printed.AGREEMENT
        # The error is a third of the difference of a second-order method with steps 2 h and h.
        assert row["global_error"] == pytest.approx(row["refinement_difference"] / 3, rel=0.05)
    assert np.isnan(rows[0]["order"])
    assert all(abs(r["order"] - 2) < 0.02 for r in rows[1:])


# -- the exhaustive scan -----------------------------------------------------------------------------------------------
# For the oscillator a step of Scheme I changes H by (lambda - 1/2) h^2 (u^2 - v^2) at its stage (v, u), and from
# (q, p) = (1, 0) the stage is u = -lambda h v: the roots are 1/2 and +-1/h.  The stage equations have the determinant
# 1 + lambda (1 - lambda) h^2; at h = 1/2 it vanishes at lambda = (1 +- sqrt 17) / 2, this side of -1/h = -2.


@pytest.fixture(scope="module")
def oscillator_scan():
    one, zero = np.array([[1.0]]), np.array([[0.0]])
    return lambda H0, **options: riddle.scan(
        problem("harmonic-oscillator"), "scheme-iv", 0.5, one, zero, H0, reach=6.0, **options
    )


def test_the_scan_finds_the_roots_that_can_be_computed(oscillator_scan):
    found = oscillator_scan(0.5)
    (roots,) = found.roots
    assert roots == pytest.approx([0.5, 2.0], abs=2e-3)
    assert found.high == pytest.approx([(1 + 17**0.5) / 2], abs=0.04)
    assert found.low == pytest.approx([(1 - 17**0.5) / 2], abs=0.04)


def test_the_scan_converges_to_them(oscillator_scan):
    far = [abs(oscillator_scan(0.5, spacing=s).roots[0][1] - 2) for s in (0.1, 0.01)]
    assert far[1] < 0.05 * far[0]


def test_the_roots_are_those_of_scheme_i():
    """The energy is kept at lambda = 2 as at 1/2, and nowhere between."""
    change = {}
    for lam in ("1/2", "2", "1"):
        s = integrate(problem("harmonic-oscillator"), method("scheme-i", lam=lam), h=0.5, steps=1)
        change[lam] = abs(s.q[-1, 0] ** 2 + s.p[-1, 0] ** 2 - 1) / 2
    assert change["1/2"] < 1e-15
    assert change["2"] < 1e-14
    assert change["1"] > 0.01


def test_the_scan_finds_no_root_where_the_energy_is_out_of_reach(oscillator_scan):
    assert [len(r) for r in oscillator_scan(1e12).roots] == [0]
    assert [len(r) for r in oscillator_scan(-1.0).roots] == [0]


def test_the_scan_refuses_a_kinetic_energy_that_is_not_quadratic():
    with pytest.raises(ValueError, match="quadratic"):
        riddle.scan(problem("lotka-volterra"), "scheme-iv", 0.1, np.ones((1, 1)), np.ones((1, 1)), 0.0)


def test_the_scan_agrees_with_the_root_finder_of_the_kernels():
    made = problem("henon-heiles:chaotic")
    for scheme in ("scheme-iv", "scheme-v"):
        s = integrate(made, scheme, h=0.02, t_end=0.2)
        found = riddle.along(made, scheme, 0.02, 0.2, reach=1.0)
        for lam, roots in list(zip(s.parameter, found.roots, strict=True))[1:]:
            assert np.abs(roots - lam).min() < 1e-3


def test_summary_counts_the_roots(oscillator_scan):
    two, none = oscillator_scan(0.5), oscillator_scan(1e12)
    (a, b) = riddle.summary([two, none])
    assert (a["steps"], a["without a root"], a["with one"], a["with more"], a["far roots"]) == (1, 0, 0, 1, 1)
    assert (b["steps"], b["without a root"], b["far roots"]) == (1, 1, 0)
    assert a["far root closest to 1/2"] == pytest.approx(2, abs=2e-3)


# -- times -------------------------------------------------------------------------------------------------------------


class Clock:
    """A clock that stands still but for what the callables of a test take."""

    def __init__(self):
        self.now, self.calls = 0.0, []

    def perf_counter(self):
        return self.now

    def takes(self, name, seconds):
        def work():
            self.calls.append(name)
            self.now += seconds(self.calls.count(name))

        return work


def test_interleaved_alternates_and_leaves_the_first_round_out(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    work = {"a": clock.takes("a", lambda n: 100.0 if n == 1 else n), "b": clock.takes("b", lambda n: 2.0 * n)}
    found = timing.interleaved(work, rounds=4)
    assert found["a"].tolist() == [2, 3, 4, 5]
    assert found["b"].tolist() == [4, 6, 8, 10]
    turns = ["".join(clock.calls[i : i + 2]) for i in range(0, 10, 2)]
    assert set(turns) == {"ab", "ba"}
    assert all(x != y for x, y in pairwise(turns))


def test_ratio_is_taken_round_by_round():
    b = np.array([1.0, 10.0, 100.0, 1.0, 5.0])
    found = timing.ratio(b * [2, 2, 3, 4, 5], b)
    assert (found.value, found.low, found.high) == (3, 2, 5)
    # not the ratio of the medians
    assert np.median(b * [2, 2, 3, 4, 5]) / np.median(b) != found.value


def test_ratio_of_real_work():
    def work(n):
        return lambda: sum(range(n))

    seconds = timing.interleaved({"long": work(40_000), "short": work(10_000)}, rounds=9)
    assert 2.5 < timing.ratio(seconds["long"], seconds["short"]).value < 6


# -- the C loop --------------------------------------------------------------------------------------------------------

needs_compiler = pytest.mark.skipif(c_loop.compiler() is None, reason="there is no C compiler")


def distance(name, h=0.01, steps=1000):
    """How far the C loop ends from stormer-verlet."""
    made = problem(name)
    seconds, y = c_loop.Loop(made).run(h, steps)
    assert seconds > 0
    s = integrate(made, "stormer-verlet", h=h, steps=steps)
    return np.abs(y - np.concatenate([s.q[-1], s.p[-1]])).max()


@needs_compiler
@pytest.mark.parametrize("name", ["pendulum", "henon-heiles:box", "kepler"])
def test_the_c_loop_is_stormer_verlet(name):
    assert distance(name) < 1e-10


@needs_compiler
@pytest.mark.parametrize(
    ("right", "wrong"), [("p_0 -= ", "p_0 += "), ("0.5 * h", "0.5001 * h"), ("q_0 += ", "q_0 -= ")]
)
def test_control_a_wrong_loop_would_be_seen(right, wrong, monkeypatch):
    source = c_loop.source
    assert right in source(problem("pendulum").system)
    monkeypatch.setattr(c_loop, "source", lambda system: source(system).replace(right, wrong))
    assert not distance("pendulum") < 1e-6


def test_the_c_loop_is_for_unit_masses():
    with pytest.raises(RuntimeError):
        c_loop.Loop(problem("lotka-volterra"))


def test_the_c_loop_says_that_there_is_no_compiler(monkeypatch):
    monkeypatch.setattr(c_loop, "compiler", lambda: None)
    with pytest.raises(RuntimeError, match="no C compiler"):
        c_loop.Loop(problem("pendulum"))
