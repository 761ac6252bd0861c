"""Cost by d: C is the same integration at every size, exponents and their intervals, and each sentence both ways."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.large import c, large, page
from phasebench.benchmarks.experiments.large.systems import SYSTEMS
from phasebench.integrators.engine import cache, codegen
from phasebench.integrators.engine.codegen import TUPLE_LIMIT
from phasebench.integrators.prepared import prepare


@pytest.mark.parametrize("name", SYSTEMS)
def test_c_and_ours_are_one_integration_on_registers_and_on_arrays(name):
    system = SYSTEMS[name]
    loop = c.Loop(system.C, system.method)
    for d in (system.size(6), system.size(TUPLE_LIMIT + 4)):
        problem = system.made(d)
        run, start = prepare(problem, system.method), np.array([problem.q0, problem.p0])
        assert large.difference(system, run, loop, start) < 1e-14
        moved = loop.run(*start, system.h, large.FEW, system.constants(d))[1] - start[0]
        assert np.abs(moved).max() > 1e4 * 1e-14


def test_control_c_with_another_constant_is_another_integration():
    system = SYSTEMS["klein-gordon"]
    d = TUPLE_LIMIT + 4
    problem, loop = system.made(d), c.Loop(system.C, system.method)
    start = np.array([problem.q0, problem.p0])
    assert large.difference(system, prepare(problem, system.method), c.Loop(system.C, "stormer-verlet"), start) < 1e-14
    ends = [loop.run(*start, system.h, large.FEW, (a, 2.0))[1] for a in (4.0, 4.001)]
    assert np.abs(ends[0] - ends[1]).max() > 1e-10


def test_rebound_takes_the_same_steps():
    """Its leapfrog is drift-kick-drift, of the second order too: the ends differ by the order's error alone."""
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


def test_sizes_are_those_that_a_system_can_have():
    for system in SYSTEMS.values():
        sizes = sorted({system.size(d) for d in large.SIZES})
        assert all(d % system.unit == 0 for d in sizes)
        assert sizes[0] >= 2
        assert 9990 <= sizes[-1] <= 10_000


def test_an_exponent_is_in_its_interval_as_often_as_said():
    d, rng = np.array([64, 128, 256, 512, 1024, 2048, 4096, 10_000]), np.random.default_rng(3)
    inside = 0
    for _ in range(1000):
        _, low, high = large.exponent(d, 3 * d**1.5 * np.exp(rng.normal(size=len(d)) / 10))
        inside += low <= 1.5 <= high
    assert 930 <= inside <= 970
    assert large.exponent(d, 3.0 * d**2)[0] == pytest.approx(2)
    assert np.isnan(large.exponent(d[:2], d[:2])).all()


def test_a_systems_functions_are_made_from_nothing_and_what_was_kept_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    before = dict(codegen._ready)
    with large.nothing_kept():
        assert cache.root() != tmp_path
        assert not codegen._ready
    assert cache.root() == tmp_path
    assert before.items() <= codegen._ready.items()
    seconds = [large.getting_ready(lambda: SYSTEMS["toda"].by_hand(24)) for _ in range(2)]
    assert min(seconds) > 0.02, "the second time it is compiled again"


# -- the sentences ---------------------------------------------------------------------------------------------------


def costs(power=1.0, times=1.5, system="toda", rebound=None, memory=1.0):
    rows = []
    for d in (16, 64, 256, 1024, 4096):
        row = {"system": system, "method": "m", "d": d, "values": "tuple" if d <= TUPLE_LIMIT else "array"}
        row |= {"ns, ours": 2.0 * times * d**power, "ns, C": 2.0 * d**power, "ours / C": times, "kB": d**memory}
        row |= {"ours / C, low": times, "ours / C, high": times, "ns, REBOUND": 1.0, "ours / REBOUND": rebound}
        rows.append(row)
    return pd.DataFrame(rows)


def said(verdict, **tables):
    return verdict({large.COSTS: None, large.MADE: None, **tables}.get)


def test_a_cost_that_grows_as_the_work_is_as_expected_and_a_steeper_one_is_not():
    linear = said(page.scaling, large=costs())
    assert linear.holds
    assert "toda 1.00" in linear.text
    assert "memory grows as d." in linear.text
    steep = said(page.scaling, large=costs(power=1.5))
    assert not steep.holds
    assert "steeper than the work: toda" in steep.text
    assert said(page.scaling, large=costs(power=2.0, system="n-body")).holds, "every pair of bodies acts"
    assert not said(page.scaling, large=costs(power=2.5, system="n-body")).holds
    assert "memory grows as d, but for toda 2.00" in said(page.scaling, large=costs(memory=2.0)).text
    assert said(page.scaling, large=costs().head(2)) is None


@pytest.mark.parametrize(("low", "holds"), [(1.0, True), (1.09, True), (1.11, False)])
def test_a_cost_is_steeper_than_the_work_where_its_whole_interval_is(monkeypatch, low, holds):
    """The upper end is far above the work each time."""
    row = {"system": "toda", "wanted": 1, "time": 1.5, "time, low": low, "time, high": 2.0, "memory": 1.0}
    monkeypatch.setattr(page, "exponents", lambda costs: pd.DataFrame([row]))
    found = said(page.scaling, large=costs())
    assert found.holds is holds
    assert f"toda 1.50 [{low:.2f}, 2.00]" in found.text
    assert ("steeper than the work: toda" in found.text) is not holds


def test_a_noisy_cost_whose_interval_holds_the_work_is_not_steeper():
    rows = costs(power=1.2)
    rows["ns, ours"] *= [1, 3, 1 / 3, 3, 1 / 3]
    interval = page.exponents(rows).iloc[0]
    assert interval["time, low"] < 1 + page.ABOVE < interval["time, high"]
    assert said(page.scaling, large=rows).holds


def test_the_cost_beside_c_and_rebound_is_told():
    near = said(page.beside, large=costs())
    assert near.holds
    assert "REBOUND" not in near.text
    far = said(page.beside, large=costs(times=7.0, rebound=0.5))
    assert not far.holds
    assert "7 (toda, d = 64)" in far.text
    assert "of REBOUND's leapfrog 0.5 to 0.5" in far.text


def test_how_far_formulae_go_is_told():
    def made(seconds, loops=1.0):
        rows = [("toda", "formula", d, s) for d, s in zip((8, 16, 32), seconds, strict=True)]
        rows.append(("toda", "loops", 10_000, loops))
        return pd.DataFrame(rows, columns=["system", "route", "d", "seconds"])

    found = said(page.limit, large_made=made((1.0, 4.0, 11.0)))
    assert found.holds
    assert "toda to d = 16" in found.text
    assert "toda to d = 32" in said(page.limit, large_made=made((1.0, 2.0, 3.0))).text
    assert not said(page.limit, large_made=made((1.0, 4.0, 11.0), loops=20.0)).holds
    assert said(page.limit, large_made=made((1.0, 2.0, 3.0)).head(3)) is None


def test_the_table_has_a_few_sizes_of_each_system():
    shown = page.table({large.COSTS: pd.concat([costs(), costs(system="fpu")], ignore_index=True)}.get)
    assert list(shown.frame["system"].unique()) == ["toda", "fpu"]
    assert list(shown.frame["d"].iloc[:4]) == [16, 64, 1024, 4096]
