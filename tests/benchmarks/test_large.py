"""Cost against d: C and Python integrate alike at every size; exponents with intervals; verdicts that pass and fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.large import c, large, page
from phasebench.benchmarks.experiments.large.systems import SYSTEMS
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count, Range
from phasebench.integrators.compile import cache, codegen
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.prepared import prepare
from support.pages import data


@pytest.mark.parametrize("name", SYSTEMS)
def test_c_and_python_integrate_alike_at_every_size(name):
    system = SYSTEMS[name]
    loop = c.Loop(system.C, system.method)
    for d in (system.size(6), system.size(TUPLE_LIMIT + 4)):
        problem = system.fastest_form(d)
        run, start = prepare(problem, system.method), np.array([problem.q0, problem.p0])
        assert large.difference(system, run, loop, start) < 1e-14
        moved = loop.run(*start, system.h, large.FEW, system.constants(d))[1] - start[0]
        assert np.abs(moved).max() > 1e4 * 1e-14


def test_control_other_constant_gives_other_states():
    """The first constant is 4; the difference is that between C with another one and our states."""
    system = SYSTEMS["klein-gordon"]
    problem = system.fastest_form(TUPLE_LIMIT + 4)
    run, start = prepare(problem, system.method), np.array([problem.q0, problem.p0])
    other = replace(system, constants=lambda d: (4.001, 2.0))
    assert large.difference(other, run, c.Loop(system.C, system.method), start) > 1e-8


def test_rebound_takes_the_same_steps():
    """REBOUND's leapfrog is drift-kick-drift, also of order 2: the states differ by the truncation error only."""
    from phasebench.reference.peers import particles

    system, d, N = SYSTEMS["n-body"], 24, 8
    setting = particles.Setting(particles.GRAVITY, (1 / N,) * N, 3, 0, (1.0,) * d)
    loop, apart = c.Loop(system.C, system.method), []
    for h in (system.h, system.h / 2):
        sim, _ = particles.build(setting, *system.start(d), "leapfrog")
        sim.dt, n = h, round(0.01 / h)
        sim.steps(n)
        sim.synchronize()
        q = loop.run(*system.start(d), h, n, system.constants(d))[1]
        apart.append(np.abs(particles.state(sim, setting)[:d] - q).max())
    assert apart[0] < 1e-4
    assert apart[0] / apart[1] == pytest.approx(4, rel=0.1)


def test_sizes_are_valid_for_each_system():
    for system in SYSTEMS.values():
        sizes = sorted({system.size(d) for d in large.SIZES})
        assert all(d % system.unit == 0 for d in sizes)
        assert sizes[0] >= 2
        assert 9990 <= sizes[-1] <= 10_000


def test_interval_of_an_exponent_covers():
    d, rng = np.array([64, 128, 256, 512, 1024, 2048, 4096, 10_000]), np.random.default_rng(3)
    inside = 0
    for _ in range(1000):
        _, low, high = large.exponent(d, 3 * d**1.5 * np.exp(rng.normal(size=len(d)) / 10))
        inside += low <= 1.5 <= high
    assert 930 <= inside <= 970
    assert large.exponent(d, 3.0 * d**2)[0] == pytest.approx(2)
    assert np.isnan(large.exponent(d[:2], d[:2])).all()


def test_functions_are_compiled_without_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    before = dict(codegen._ready)
    with large.nothing_kept():
        assert cache.root() != tmp_path
        assert not codegen._ready
    assert cache.root() == tmp_path
    assert before.items() <= codegen._ready.items()
    seconds = [large.getting_ready(lambda: SYSTEMS["toda"].by_hand(24)) for _ in range(2)]
    assert min(seconds) > 0.02, "the second time it is compiled again"


# -- the verdicts ---------------------------------------------------------------------------------------------------


def costs(power=1.0, times=1.5, system="toda", rebound=None, memory=1.0):
    """Fabricated costs per step of one system against d: our time grows as d^power, memory as d^memory.

    Ours is ``times`` the time of C; ``rebound`` is the ratio to REBOUND's.
    """
    rows = []
    for d in (16, 64, 256, 1024, 4096):
        row = {"system": system, "method": "m", "d": d, "values": "tuple" if d <= TUPLE_LIMIT else "array"}
        row |= {"ns, ours": 2.0 * times * d**power, "ns, C": 2.0 * d**power, "ours / C": times, "kB": d**memory}
        row |= {"ours / C, low": times, "ours / C, high": times, "ns, REBOUND": 1.0, "ours / REBOUND": rebound}
        rows.append(row)
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("system", "power", "outcome"),
    [("toda", 1.0, PASS), ("toda", 1.5, FINDING), ("n-body", 2.0, PASS), ("n-body", 2.5, FINDING)],
)
def test_time_may_grow_like_the_work(system, power, outcome):
    """In the n-body problem every pair of bodies interacts, so the work grows as d^2."""
    found = page.scaling(data(large=costs(power=power, system=system)))
    assert (found.measured, found.outcome) == (Count(int(outcome == PASS), 1), outcome)


def test_two_sizes_give_no_exponent():
    assert page.scaling(data(large=costs().head(2))) is None


@pytest.mark.parametrize(("low", "outcome"), [(1.0, PASS), (1.09, PASS), (1.11, FINDING)])
def test_cost_is_too_steep_only_with_its_whole_interval(monkeypatch, low, outcome):
    """The verdict fails only if the lower end of the exponent's interval is too large; the upper end always is."""
    row = {"system": "toda", "expected": 1, "time": 1.5, "time, low": low, "time, high": 2.0}
    monkeypatch.setattr(page, "exponents", lambda costs: pd.DataFrame([row]))
    assert page.scaling(data(large=costs())).outcome == outcome


def test_noisy_cost_consistent_with_the_work_passes():
    rows = costs(power=1.2)
    rows["ns, ours"] *= [1, 3, 1 / 3, 3, 1 / 3]
    interval = page.exponents(rows).iloc[0]
    assert interval["time, low"] < 1 + page.ABOVE < interval["time, high"]
    assert page.scaling(data(large=rows)).outcome == PASS


def test_worst_ratio_to_c_of_large_systems_is_judged():
    near, far = page.beside(data(large=costs())), page.beside(data(large=costs(times=7.0)))
    assert (near.measured, near.outcome) == (Range(1.5, 1.5), PASS)
    assert (far.measured, far.outcome, far.where) == (Range(7.0, 7.0), FINDING, "toda, d = 64")
    small = costs()
    small.loc[small["d"] < large.MANY, "ours / C"] = 9.0
    assert page.beside(data(large=small)).outcome == PASS


def seconds_table(seconds=(1.0, 4.0, 11.0), loops=1.0):
    """A fabricated table of compilation times: H by a formula at d = 8, 16, 32, and by loops at d = 10000."""
    rows = [("toda", "formula", d, s) for d, s in zip((8, 16, 32), seconds, strict=True)]
    rows.append(("toda", "loops", 10_000, loops))
    return pd.DataFrame(rows, columns=["system", "route", "d", "seconds"])


@pytest.mark.parametrize(("seconds", "outcome"), [(large.PATIENCE, PASS), (20.0, FINDING)])
def test_loops_must_compile_in_time(seconds, outcome):
    found = page.loops(data(large_made=seconds_table(loops=seconds)))
    assert (found.measured, found.outcome, found.where) == (seconds, outcome, "toda, d = 10000")
    assert page.loops(data(large_made=seconds_table().head(3))) is None


def test_largest_size_of_a_formula():
    assert page.largest_derived(seconds_table()) == {"toda": 16}
    assert page.largest_derived(seconds_table((1.0, 2.0, 3.0))) == {"toda": 32}
    assert page.largest_derived(seconds_table((11.0, 12.0, 13.0))) == {}


def test_table_has_a_few_sizes_of_each_system():
    shown = page.table({large.COSTS: pd.concat([costs(), costs(system="fpu")], ignore_index=True)}.get)
    assert list(shown.frame["system"].unique()) == ["toda", "fpu"]
    assert list(shown.frame["d"].iloc[:4]) == [16, 64, 1024, 4096]
