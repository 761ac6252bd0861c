"""Warm times of every method, and the ratios that are claimed, each measured in one run."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.c_loop import Loop
from phasebench.benchmarks.measure.timing import interleaved, ratio
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate, warm
from phasebench.integrators.registry import method

H, STEPS = 0.01, 10_000
PROBLEMS = ("pendulum", "henon-heiles:chaotic", "perturbed-kepler")


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("variant", list(sweep.variants()), ids=lambda v: method(v[0], **dict(v[1])).label)
def bench_method(benchmark, name, variant, results, quick):
    """The warm integration alone: compiled, no output, no checks; error, evaluations and steps in ``extra_info``."""
    found, chosen = problem(name), method(variant[0], **dict(variant[1]))
    if chosen.lacks(found.system):
        pytest.skip(chosen.lacks(found.system))
    steps = STEPS // 10 if quick else STEPS
    full = integrate(found, chosen, h=H, steps=steps)
    E = found.system.observe(found.system.H, full.q, full.p)
    benchmark.group = f"{name}, h = {H}, {steps} steps"
    benchmark.extra_info |= {"energy_error": float(metrics.invariant_error(E).max), "status": full.status} | full.counts
    benchmark.pedantic(warm(found, chosen, h=H, steps=steps), rounds=3 if quick else 11, warmup_rounds=1)
    if benchmark.stats is not None:
        results.add(
            "speed",
            [
                {
                    "problem": found.label,
                    "method": chosen.label,
                    "ns per step": benchmark.stats.stats.median / steps * 1e9,
                    "gradients per step": full.counts["gradient"] / steps,
                    "energy error": float(metrics.invariant_error(E).max),
                    "status": full.status,
                }
            ],
        )


def _add(results, what, a, b, limit, includes):
    r = ratio(a, b)
    results.add(
        "ratios",
        [
            {
                "ratio": what,
                "median": r.value,
                "lower quartile": r.low,
                "upper quartile": r.high,
                "wanted, at most": limit,
                "what is timed": includes,
            }
        ],
    )


@pytest.mark.parametrize("name", ["kepler", "henon-heiles:chaotic", "pendulum"])
def bench_against_c(name, results, quick):
    """A compensated Stormer-Verlet step against the bare C loop of the same formula."""
    found = problem(name)
    try:
        loop = Loop(found)
    except RuntimeError as error:
        pytest.skip(str(error))
    steps, rounds = (100_000, 9) if quick else (400_000, 21)
    ours = warm(found, "stormer-verlet", h=H, steps=steps)
    work = {"ours": ours, "C": lambda: loop.run(H, steps)}
    if name.startswith("henon"):
        work["scheme-i"] = warm(found, method("scheme-i"), h=H, steps=steps)
    q, p = ours()
    end = loop.run(H, steps)[1]
    times = interleaved(work, rounds)
    timed = f"{steps} steps of h = {H}, warm, no output; C: gcc -O3 -march=native, uncompensated"
    _add(results, f"Stormer-Verlet / C loop, {found.label}", times["ours"], times["C"], 1.4, timed)
    if "scheme-i" in work:
        _add(results, f"Scheme I(1/3) / C Stormer-Verlet, {found.label}", times["scheme-i"], times["C"], 10, timed)
    if name == "pendulum":  # regular motion: the two loops must be the same integration
        assert abs(q[0] - end[0]) + abs(p[0] - end[1]) < 1e-6


@pytest.mark.parametrize("name", PROBLEMS)
def bench_scheme_v_against_iii(name, results, quick):
    """What the energy costs: a Scheme V step in Scheme III steps, a Scheme IV step in midpoint steps."""
    found = problem(name)
    steps, rounds = (5_000, 9) if quick else (50_000, 21)
    work = {
        m: warm(found, m, h=H, steps=steps) for m in ("scheme-iii", "scheme-v", "implicit-midpoint", "scheme-iv", "avf")
    }
    times = interleaved(work, rounds)
    timed = f"{steps} steps of h = {H}, warm, no output"
    _add(results, f"Scheme V / Scheme III(1/3), {found.label}", times["scheme-v"], times["scheme-iii"], 8, timed)
    _add(
        results,
        f"Scheme IV / implicit midpoint, {found.label}",
        times["scheme-iv"],
        times["implicit-midpoint"],
        None,
        timed,
    )
    _add(results, f"AVF / implicit midpoint, {found.label}", times["avf"], times["implicit-midpoint"], None, timed)
