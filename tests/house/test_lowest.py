"""What the gate tries on the lowest versions that are declared: of every family a method compiles and runs.

The tests that are marked ``lowest`` run there, with the quick tier of the main job.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement

from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from phasebench.integrators.registry import METHODS

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = [problem(name) for name in ("henon-heiles:box", "perturbed-kepler")]
#: The first method of each family.
FIRST = {m.family: m for m in reversed(METHODS)}
#: Steps are short, and no method errs by more on so short a span.
H, STEPS, ERROR = 0.01, 10, 0.02


@pytest.mark.lowest
@pytest.mark.parametrize("family", FIRST)
def test_a_method_of_every_family_compiles_and_runs(family):
    made = next(x for x in PROBLEMS if FIRST[family].lacks(x.system) is None)
    solution = integrate(made, FIRST[family], h=H, steps=STEPS, t_end=H * STEPS)
    assert solution.status == "ok"
    exact = integrate(made, "dop853", h=H / 10, steps=10 * STEPS, t_end=H * STEPS)
    assert np.abs(solution.q[-1] - np.array(made.q0)).max() > 0
    assert np.abs(solution.q[-1] - exact.q[-1]).max() < ERROR


def floors(*extras: str) -> dict[str, str]:
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "floors", *extras], capture_output=True, text=True, check=True
    )
    return dict(line.split("==") for line in done.stdout.splitlines())


def test_every_dependency_has_a_lowest_version_that_is_allowed():
    found = floors("test")
    project = Path(ROOT / "pyproject.toml").read_text()
    assert len(found) == 22
    for name, version in found.items():
        assert f'"{name}>={version}"' in project
        assert Requirement(f"{name}>={version}").specifier.contains(version)


@pytest.mark.lowest
def test_no_dependency_is_older_than_what_is_allowed():
    from importlib.metadata import version

    from packaging.version import Version

    assert all(Version(version(name)) >= Version(lowest) for name, lowest in floors("test").items())
