"""The talks' printed columns, the exhaustive root scan, timing, and the C loop."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure import c_loop, root_scan, timing
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies import printed
from phasebench.integrators import integrate
from phasebench.integrators.registry import method
from phasebench.reference import native

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
    rows = printed.column("scheme-ii", **{"lambda": "1/3"})
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
        # The error of a second-order method is a third of the difference between the results with 2 h and h.
        assert row["global_error"] == pytest.approx(row["refinement_difference"] / 3, rel=0.05)
    assert np.isnan(rows[0]["order"])
    assert all(abs(r["order"] - 2) < 0.02 for r in rows[1:])


#: The talk's columns, copied from it independently.
TALK = """
4.31E-03 2.09E-03 1.03E-03 5.13E-04   4.38E-04 2.23E-04 1.12E-04 5.63E-05   2.63E-03 1.34E-03 6.73E-04 3.38E-04
3.85E-03 1.98E-03 1.00E-03 5.06E-04   5.09E-04 1.25E-04 3.11E-05 7.74E-06   2.35E-05 5.87E-06 1.47E-06 3.67E-07
2.24E-04 5.67E-05 1.42E-05 3.57E-06   4.77E-04 1.21E-04 3.06E-05 7.68E-06   1.12E-04 2.79E-05 6.97E-06 1.74E-06
3.54E-06 8.84E-07 2.21E-07 5.52E-08   5.04E-05 1.26E-05 3.15E-06 7.88E-07   1.18E-04 2.94E-05 7.34E-06 1.84E-06
1.78E-05 4.46E-06 1.11E-06 2.78E-07   2.50E-03 1.24E-03 6.22E-04 3.10E-04   4.23E-06 1.06E-06 2.64E-07 6.60E-08
"""


def test_printed_columns_equal_the_talks():
    assert [entry for column in printed.PRINTED.values() for entry in column] == TALK.split()


# -- recipes for Scheme IV's column ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ways():
    """{name of a recipe, a way to compute the talk's printed differences: its column} for three printed."""
    wanted = ("Scheme IV, one step more", "Scheme I, lambda = -51/50, in q alone", "Scheme I, lambda = -2/5")
    found = problem("henon-heiles:chaotic")
    return {r.name: r.column(found) for r in printed.RECIPES if r.name in wanted}


def test_nearest_recipes_have_known_columns(ways):
    more = ways["Scheme IV, one step more"]
    assert more == pytest.approx([2.573e-3, 1.294e-3, 0.648e-3, 0.325e-3], abs=0.0006e-3)
    assert [f"{x:.2E}" for x in ways["Scheme I, lambda = -51/50, in q alone"]] == [
        "2.50E-03", "1.24E-03", "6.20E-04", "3.10E-04",
    ]  # fmt: skip
    assert [printed.agreeing(column) for column in ways.values()] == [1, 0, 3]


def test_recipe_with_one_step_more():
    """States one step after t = 1 differ, between h and 2 h, by h times the velocity: the column halves with h."""
    recipe = printed.Recipe("", method("implicit-midpoint"), beyond=1)
    column = recipe.column(problem("henon-heiles:chaotic"))
    assert all(1.95 < a / b < 2.05 for a, b in pairwise(column))


@pytest.mark.parametrize(("units", "agree"), [(0.59, 4), (0.61, 0)])
def test_agreeing_entries_are_counted_in_units_of_a_digit(units, agree):
    column = [float(t) + units * printed.unit(t) for t in ("2.50E-03", "1.24E-03", "6.22E-04", "3.10E-04")]
    assert printed.agreeing(column) == agree


# -- the exhaustive scan -----------------------------------------------------------------------------------------------
# On the oscillator a step of Scheme I changes H by (lambda - 1/2) h^2 (u^2 - v^2) at its stage (v, u); from
# (q, p) = (1, 0) the stage has u = -lambda h v: the roots are 1/2 and +-1/h.  The stage equations have determinant
# 1 + lambda (1 - lambda) h^2; at h = 1/2 it vanishes at lambda = (1 +- sqrt 17) / 2, on this side of -1/h = -2.


@pytest.fixture(scope="module")
def oscillator_scan():
    one, zero = np.array([[1.0]]), np.array([[0.0]])
    return lambda H0, **options: root_scan.scan(
        problem("harmonic-oscillator"), "scheme-iv", 0.5, one, zero, H0, reach=6.0, **options
    )


def test_scan_finds_the_known_roots(oscillator_scan):
    found = oscillator_scan(0.5)
    (roots,) = found.roots
    assert roots == pytest.approx([0.5, 2.0], abs=2e-3)
    assert found.high == pytest.approx([(1 + 17**0.5) / 2], abs=0.04)
    assert found.low == pytest.approx([(1 - 17**0.5) / 2], abs=0.04)


def test_scan_converges_to_the_roots(oscillator_scan):
    far = [abs(oscillator_scan(0.5, spacing=s).roots[0][1] - 2) for s in (0.1, 0.01)]
    assert far[1] < 0.05 * far[0]


def test_roots_preserve_the_energy_of_scheme_i():
    """The energy is preserved at lambda = 2 and 1/2, and not between."""
    change = {}
    for lam in ("1/2", "2", "1"):
        s = integrate(problem("harmonic-oscillator"), method("scheme-i", lam=lam), h=0.5, steps=1)
        change[lam] = abs(s.q[-1, 0] ** 2 + s.p[-1, 0] ** 2 - 1) / 2
    assert change["1/2"] < 1e-15
    assert change["2"] < 1e-14
    assert change["1"] > 0.01


def test_scan_finds_no_root_for_an_unreachable_energy(oscillator_scan):
    assert [len(r) for r in oscillator_scan(1e12).roots] == [0]
    assert [len(r) for r in oscillator_scan(-1.0).roots] == [0]


def test_scan_refuses_a_nonquadratic_kinetic_energy():
    with pytest.raises(ValueError, match="quadratic"):
        root_scan.scan(problem("lotka-volterra"), "scheme-iv", 0.1, np.ones((1, 1)), np.ones((1, 1)), 0.0)


def test_scan_agrees_with_the_root_finder_of_the_kernels():
    made = problem("henon-heiles:chaotic")
    for scheme in ("scheme-iv", "scheme-v"):
        s = integrate(made, scheme, h=0.02, t_end=0.2)
        found = root_scan.along(made, scheme, 0.02, 0.2, reach=1.0)
        for lam, roots in list(zip(s.parameter, found.roots, strict=True))[1:]:
            assert np.abs(roots - lam).min() < 1e-3


def test_summary_counts_the_roots(oscillator_scan):
    two, none = oscillator_scan(0.5), oscillator_scan(1e12)
    (a, b) = root_scan.summary([two, none])
    assert (a["steps"], a["without a root"], a["with one"], a["with more"], a["far roots"]) == (1, 0, 0, 1, 1)
    assert (b["steps"], b["without a root"], b["far roots"]) == (1, 1, 0)
    assert a["far root closest to 1/2"] == pytest.approx(2, abs=2e-3)


# -- times -------------------------------------------------------------------------------------------------------------


class Clock:
    """A fake clock, which only the callables of a test advance."""

    def __init__(self):
        self.now, self.calls = 0.0, []

    def perf_counter(self):
        return self.now

    def takes(self, name, seconds):
        def work():
            self.calls.append(name)
            self.now += seconds(self.calls.count(name))

        return work


def test_interleaved_alternates_and_drops_the_first_round(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    work = {"a": clock.takes("a", lambda n: 100.0 if n == 1 else n), "b": clock.takes("b", lambda n: 2.0 * n)}
    found = timing.time_in_turns(work, rounds=4)
    assert found["a"].tolist() == [2, 3, 4, 5]
    assert found["b"].tolist() == [4, 6, 8, 10]
    turns = ["".join(clock.calls[i : i + 2]) for i in range(0, 10, 2)]
    assert set(turns) == {"ab", "ba"}
    assert all(x != y for x, y in pairwise(turns))


def test_ratio_is_the_median_over_rounds():
    b = np.array([1.0, 10.0, 100.0, 1.0, 5.0])
    found = timing.ratio(b * [2, 2, 3, 4, 5], b)
    assert (found.value, found.low, found.high) == (3, 2, 5)
    # not the ratio of the medians
    assert np.median(b * [2, 2, 3, 4, 5]) / np.median(b) != found.value


def test_ratio_of_real_work():
    def work(n):
        return lambda: sum(range(n))

    seconds = timing.time_in_turns({"long": work(40_000), "short": work(10_000)}, rounds=9)
    assert 2.5 < timing.ratio(seconds["long"], seconds["short"]).value < 6


# -- the C loop --------------------------------------------------------------------------------------------------------

needs_compiler = pytest.mark.skipif(c_loop.compiler() is None, reason="there is no C compiler")


def distance(name, h=0.01, steps=1000, merged=False):
    """Largest difference between the final states of the C loop and of stormer-verlet."""
    made = problem(name)
    seconds, y = c_loop.Loop(made, merged).run(h, steps)
    assert 0 < seconds < 60, "of the loop, not of the clock"
    s = integrate(made, "stormer-verlet", h=h, steps=steps)
    return np.abs(y - np.concatenate([s.q[-1], s.p[-1]])).max()


@needs_compiler
@pytest.mark.parametrize("name", ["pendulum", "henon-heiles:box", "kepler", "outer-solar-system"])
@pytest.mark.parametrize("merged", [False, True])
def test_c_loop_is_stormer_verlet(name, merged):
    assert distance(name, merged=merged) < 1e-10


@needs_compiler
@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("p_0 -= ", "p_0 += "),
        ("0.5 * h", "0.5001 * h"),
        ("q_0 += ", "q_0 -= "),
        ("p_0 += 0.5 * ", "p_0 += 0.51 * "),
    ],
)
def test_control_wrong_loop_is_detected(right, wrong, monkeypatch):
    source, merged = c_loop.source, right.startswith("p_0 += ")
    assert right in source(problem("pendulum").system, merged)
    monkeypatch.setattr(c_loop, "source", lambda *of: source(*of).replace(right, wrong))
    assert not distance("pendulum", merged=merged) < 1e-6


@needs_compiler
def test_kicks_are_merged_only_on_request():
    """The C loop merges neighbouring kicks, which changes the last digits of the state, only on request."""
    made = problem("pendulum")
    assert c_loop.source(made.system) == c_loop.source(made.system, False) != c_loop.source(made.system, True)
    ends = {merged: c_loop.Loop(made, merged).run(0.1, 1000)[1].tolist() for merged in (False, True)}
    assert c_loop.Loop(made).run(0.1, 1000)[1].tolist() == ends[False] != ends[True]


def test_c_loop_needs_a_quadratic_kinetic_energy():
    for made in (SimpleNamespace(system=SimpleNamespace()), problem("lotka-volterra")):
        with pytest.raises(RuntimeError, match="quadratic T"):
            c_loop.Loop(made)


@needs_compiler
def test_invalid_c_raises_the_compilers_message():
    with pytest.raises(RuntimeError, match=r"failed: [^']*error"):
        c_loop.load_source("this is no C")


def test_missing_c_compiler_is_reported(monkeypatch):
    monkeypatch.setattr(native, "compiler", lambda language="C": None)
    with pytest.raises(RuntimeError, match="no C compiler"):
        c_loop.Loop(problem("pendulum"))
