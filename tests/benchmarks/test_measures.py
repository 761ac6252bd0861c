"""The exhaustive root scan, times and which of two is cheaper, and the C loop."""

from __future__ import annotations

from itertools import pairwise
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure import c_loop, root_scan, timing
from phasebench.benchmarks.measure.timing import NONE, NOWHERE, OURS, PEERS, TIED, Median
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.models import planets
from phasebench.integrators import integrate
from phasebench.reference import native

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


def test_scan_agrees_with_the_root_finder_of_the_kernels():
    made = problem("henon-heiles:chaotic")
    for scheme in ("scheme-iv", "scheme-v"):
        s = integrate(made, scheme, h=0.02, t_end=0.2)
        found = root_scan.along(made, scheme, 0.02, 0.2, reach=1.0)
        for lam, roots in list(zip(s.parameter, found.roots, strict=True))[1:]:
            assert np.abs(roots - lam).min() < 1e-3


# -- models ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rungs", [planets.planet_models(), planets.particle_models()])
def test_model_of_the_planets_starts_where_they_are(rungs):
    full = problem("outer-solar-system")
    for rung in rungs[:-1]:
        made = rung.make()
        q, _ = rung.lift(full, np.zeros(1), np.array([made.q0]), np.array([made.p0]))
        known = ~np.isnan(q[0])
        assert 3 < known.sum() < full.system.d
        assert np.array_equal(q[0, known], np.array(full.q0)[known])


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


@pytest.mark.parametrize("n", [6, 11, 21])
def test_interval_covers_the_median_of_skewed_times(n):
    """Times are bounded below and have a long tail; a narrower interval would not cover."""
    draws = 1 + np.random.default_rng(n).exponential(size=(20_000, n))
    found = [timing.median(row) for row in draws]
    true = 1 + np.log(2)
    covered = np.mean([m.low <= true <= m.high for m in found])
    assert covered + 0.005 >= 0.95
    assert covered <= 0.995
    k = timing.rank(n)
    inner = np.sort(draws, axis=1)[:, [k, -k - 1]]
    assert np.mean((inner[:, 0] <= true) & (true <= inner[:, 1])) < 0.95


ONE, TWO, WIDE = Median(1.0, 0.9, 1.1), Median(2.0, 1.9, 2.1), Median(2.0, 1.05, 3.0)


@pytest.mark.parametrize(
    ("ours", "peers", "said"),
    [
        (ONE, TWO, OURS),
        (TWO, ONE, PEERS),
        (ONE, ONE, TIED),
        (ONE, WIDE, TIED),
        (WIDE, ONE, TIED),
        (ONE, NOWHERE, OURS),
        (NOWHERE, ONE, PEERS),
        (NOWHERE, NOWHERE, NONE),
        # The accuracy is reached only perhaps.
        (Median(1.0, 0.9, inf), TWO, TIED),
        (Median(1.0, 0.9, inf), NOWHERE, TIED),
        (Median(3.0, 2.9, inf), TWO, PEERS),
        (NOWHERE, Median(1.0, 0.9, inf), TIED),
    ],
)
def test_cheaper_of_two_costs(ours, peers, said):
    assert timing.cheaper(ours, peers) == said


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
@pytest.mark.parametrize(("name", "merged"), [("pendulum", True), ("kepler", False), ("outer-solar-system", False)])
def test_c_loop_is_stormer_verlet(name, merged):
    assert distance(name, merged=merged) < 1e-10


@needs_compiler
@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("p_0 -= ", "p_0 += "),
        ("p_0 += 0.5 * ", "p_0 += 0.51 * "),
    ],
)
def test_control_wrong_loop_is_detected(right, wrong, monkeypatch):
    source, merged = c_loop.source, right.startswith("p_0 += ")
    assert right in source(problem("pendulum").system, merged)
    monkeypatch.setattr(c_loop, "source", lambda *of: source(*of).replace(right, wrong))
    assert not distance("pendulum", merged=merged) < 1e-6


def test_c_loop_needs_a_quadratic_kinetic_energy():
    for made in (SimpleNamespace(system=SimpleNamespace()), problem("lotka-volterra")):
        with pytest.raises(RuntimeError, match="quadratic T"):
            c_loop.Loop(made)


def test_missing_c_compiler_is_reported(monkeypatch):
    monkeypatch.setattr(native, "compiler", lambda language="C": None)
    with pytest.raises(RuntimeError, match="no C compiler"):
        c_loop.Loop(problem("pendulum"))


def test_ranks_agree_with_published_tables():
    """David & Nagaraja; the sign test's critical values at 5 %, two-sided."""
    assert [timing.rank(n) for n in (3, 5, 6, 8, 9, 11, 12, 15, 20, 21, 25)] == [1, 1, 1, 1, 2, 2, 3, 4, 6, 6, 8]
    assert timing.rank(40_001) == 19_805  # n/2 - 0.98 sqrt(n), computed exactly and fast
