"""Times of every method by pytest-benchmark, if an option --benchmark-* is given."""

from __future__ import annotations

from typing import Any

import pytest

from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method

H, STEPS = 0.01, 10_000
METHODS = [method(id, **dict(parameters)) for id, parameters in variants()]


@pytest.mark.parametrize("problem", ["pendulum", "henon-heiles:chaotic", "perturbed-kepler"])
@pytest.mark.parametrize("chosen", METHODS, ids=lambda m: m.label)
def bench_step(benchmark: Any, problem: str, chosen: Any) -> None:
    """Time a compiled run of a method on a problem; ``benchmark`` is the fixture of pytest-benchmark."""
    made = problem_of(problem)
    if chosen.lacks(made.system):
        pytest.skip(chosen.lacks(made.system))
    benchmark.group = f"{problem}, h = {H}, {STEPS} steps"
    benchmark.pedantic(prepare(made, chosen), (H, STEPS), rounds=11, warmup_rounds=1)
