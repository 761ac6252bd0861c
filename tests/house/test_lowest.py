"""With the lowest declared versions of all dependencies, one method of each family compiles and runs.

The gate runs the tests marked ``lowest`` in such an environment, with the quick tier of the benchmark job.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from packaging.version import Version

from phasebench.benchmarks.measure.battery import as_problem
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from support.one_of_each import FIRST

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = [problem(name) for name in ("henon-heiles:box", "perturbed-kepler", "magnetic-mirror")]
PROBLEMS += [as_problem(name) for name in ("on-sphere", "asymmetric-top", "many-parts")]
#: Bound on the error of any method over so short a span, as a share of the way that q, or p, goes.
H, STEPS, ERROR = 0.01, 10, 0.2


@pytest.mark.lowest
@pytest.mark.parametrize("family", FIRST)
def test_a_method_of_every_family_compiles_and_runs(family):
    made = next(x for x in PROBLEMS if FIRST[family].lacks(x.system) is None)
    solution = integrate(made, FIRST[family], h=H, steps=STEPS, t_end=H * STEPS)
    assert solution.status == "ok"
    exact = integrate(made, "dop853", h=H / 10, steps=10 * STEPS, t_end=H * STEPS)
    for end, true, start in ((solution.q[-1], exact.q[-1], made.q0), (solution.p[-1], exact.p[-1], made.p0)):
        moved = np.abs(true - np.array(start)).max()
        assert np.abs(end - true).max() < ERROR * moved


def floors(*extras: str) -> dict[str, str]:
    """Lowest declared version of each dependency, as .ci/floors prints it."""
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "floors", *extras], capture_output=True, text=True, check=True
    )
    return dict(line.split("==") for line in done.stdout.splitlines())


def test_every_dependency_declares_a_lowest_version():
    found = floors("test")
    project = (ROOT / "pyproject.toml").read_text()
    assert len(found) == 23
    assert all(f'"{name}>={version}"' in project for name, version in found.items())


@pytest.mark.lowest
def test_installed_versions_are_at_least_the_lowest():
    from importlib.metadata import version

    assert all(Version(version(name)) >= Version(lowest) for name, lowest in floors("test").items())
