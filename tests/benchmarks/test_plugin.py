"""The pytest plugin in another project: tests pass, fail readably, and unused it imports nothing heavy."""

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
TUTORIAL = (ROOT / "docs" / "tutorials" / "certificate-in-ci.md").read_text()
#: Needed where the plugin is not registered as an entry point.
REGISTERED = bool(importlib.metadata.entry_points(group="pytest11", name="phasebench"))
LOAD = () if REGISTERED else ("-p", PLUGIN)


@pytest.fixture
def project(tmp_path):
    """A project with the tutorial's integrator, in its first version, and its test."""
    for name, code in reversed(re.findall(r"%%writefile (\S+)\n(.*?)```", TUTORIAL, re.DOTALL)):
        (tmp_path / name).write_text(code)
    return tmp_path


def run(project, *arguments):
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(command, cwd=project, env=dict(os.environ), capture_output=True, text=True, check=False)


def test_tutorials_test_passes_and_fails_readably(project):
    done = run(project, "pytest", *LOAD, "-q", "test_my_integrator.py")
    assert done.returncode == 0, done.stdout + done.stderr
    step = project / "my_integrator.py"
    step.write_text(step.read_text().replace("h / 2", "h / 3"))
    done = run(project, "pytest", *LOAD, "-q", "test_my_integrator.py")
    assert done.returncode == 1
    assert "consistent: contradicted" in done.stdout
    assert "Traceback" not in done.stdout
    assert "certificate.py" not in done.stdout


#: A test that prints the heavy modules imported by a pytest run without the fixture.
UNUSED = """
def test_nothing_else():
    import json, sys
    heavy = ("phasebench.integrators.driver", "phasebench.integrators.systems")
    heavy += ("sympy", "numba", "numpy", "scipy", "pandas", "matplotlib")
    print("LOADED", json.dumps([m for m in heavy if m in sys.modules]))
"""


def test_unused_plugin_imports_nothing_heavy(tmp_path):
    (tmp_path / "test_other.py").write_text(UNUSED)
    others = ("-p", "no:hypothesispytest", "-p", "no:jaxtyping", "-p", "no:benchmark")
    done = run(tmp_path, "pytest", *LOAD, *others, "-q", "-s", "test_other.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(re.search(r"LOADED (.*)", done.stdout)[1]) == []


def test_true_claims_return_and_false_claims_fail(request):
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
