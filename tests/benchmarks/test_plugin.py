"""The pytest plugin in a stranger's project: it passes, fails readably, and loads nothing where it is not used."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from support.steps import leapfrog

ROOT = Path(__file__).resolve().parents[2]
PLUGIN = "phasebench.benchmarks.certificate.plugin"
README = (ROOT / "README.md").read_text()
#: What an installation that is older than the plugin needs.
REGISTERED = bool(importlib.metadata.entry_points(group="pytest11", name="phasebench"))
LOAD = () if REGISTERED else ("-p", PLUGIN)


@pytest.fixture
def project(tmp_path):
    """A scratch project with the README's step and its test."""
    for code in re.findall(r"```python\n(.*?)```", README, re.DOTALL):
        name = re.match(r'"""((?:test_)?my_step\.py):', code)
        if name:
            (tmp_path / name[1]).write_text(code)
    return tmp_path


def run(project, *arguments):
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(command, cwd=project, env=dict(os.environ), capture_output=True, text=True, check=False)


def test_a_stranger_s_test_passes_and_fails_readably(project):
    done = run(project, "pytest", *LOAD, "-q", "test_my_step.py")
    assert done.returncode == 0, done.stdout + done.stderr
    step = project / "my_step.py"
    step.write_text(step.read_text().replace("h / 2", "h / 3"))
    done = run(project, "pytest", *LOAD, "-q", "test_my_step.py")
    assert done.returncode == 1
    assert "consistent: contradicted" in done.stdout
    assert "Traceback" not in done.stdout
    assert "certificate.py" not in done.stdout


#: Prints what a run of pytest has loaded that does not use the fixture.
UNUSED = """
def test_nothing_else():
    import json, sys
    heavy = ("phasebench.integrators.driver", "phasebench.integrators.systems")
    heavy += ("sympy", "numba", "numpy", "scipy", "pandas", "matplotlib")
    print("LOADED", json.dumps([m for m in heavy if m in sys.modules]))
"""


def test_a_run_that_does_not_use_it_loads_nothing(tmp_path):
    (tmp_path / "test_other.py").write_text(UNUSED)
    others = ("-p", "no:hypothesispytest", "-p", "no:jaxtyping", "-p", "no:benchmark")
    done = run(tmp_path, "pytest", *LOAD, *others, "-q", "-s", "test_other.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(re.search(r"LOADED (.*)", done.stdout)[1]) == []


def test_what_the_readme_s_workflow_runs():
    """Its lines are run by the gate (.ci/plugin), and but for the folder's name in `test_documents` and above."""
    (workflow,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    assert re.findall(r"- run: (.*)", workflow) == [
        'python -m pip install "$PHASEBENCH"',
        "phasebench validate ./my_step.py --output certificate",
        "python -m pytest test_my_step.py",
    ]
    assert "\nphasebench validate ./my_step.py --output my-certificate\n" in README
    assert ".ci/plugin" in (ROOT / ".ci" / "run").read_text()


def test_claims_that_hold_return_what_was_measured_and_others_fail_with_it(request):
    claims_hold = importlib.import_module(PLUGIN).claims_hold
    for requires in ("separable", ("separable",)):
        found = claims_hold(leapfrog, requires=requires, order=2)
        assert (found.verdict, found.requires, found.seed, found.offers) == ("pass", ("separable",), 0, [])
    with pytest.raises(pytest.fail.Exception, match="order 3: contradicted") as failure:
        claims_hold(leapfrog, requires="separable", seed=4, order=3)
    assert not failure.value.pytrace, "what is wrong is no line of ours"
    with pytest.raises(TypeError):
        claims_hold(leapfrog, "separable")
    if REGISTERED:
        assert request.getfixturevalue("phasebench_claims")(leapfrog, requires="separable", order=2).verdict == "pass"
