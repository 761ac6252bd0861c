"""A wheel, installed and used beside a folder named ``benchmarks``: nothing is missing, nothing is mixed up."""

from __future__ import annotations

import importlib.metadata
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: What the licence's form in pyproject.toml needs.
SETUPTOOLS = 77
#: Reads every kind of data that is no Python, by the code that reads it in use.
USE = """
import phasebench as pb
from phasebench.benchmarks import bibliography
from phasebench.benchmarks.advice import prior
from phasebench.benchmarks.certificate import fronts
from phasebench.integrators import coefficients
from phasebench.reference import tables
from phasebench.reference.certificates import stored
from pathlib import Path

assert Path(pb.__file__).is_relative_to({site!r}), pb.__file__
s = pb.integrate("pendulum", "stormer-verlet", h=0.1, t_end=1)
assert s.status == "ok"
assert coefficients.polished("pefrl")
assert bibliography.cited(["pefrl", "pendulum"])
assert stored.find(pb.problem("pendulum")).ends
assert list(Path(tables.__file__).parent.glob("*.csv"))
assert prior.stored()
assert fronts.stored()
print(s.q[-1][0])
"""


def run(*command, cwd) -> str:
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> tuple[Path, Path]:
    """(programs, site-packages) of an environment with a wheel of this tree and what is installed here."""
    try:
        if int(importlib.metadata.version("setuptools").split(".")[0]) < SETUPTOOLS:
            pytest.skip(f"setuptools is older than {SETUPTOOLS}")
        importlib.metadata.version("pip")
    except importlib.metadata.PackageNotFoundError as error:
        pytest.skip(f"{error.name} is not installed, and a test fetches nothing")
    folder = tmp_path_factory.mktemp("installation")
    source = folder / "source"
    leave = shutil.ignore_patterns(".*", "__pycache__", "reports", "tests", "build", "*.egg-info")
    shutil.copytree(ROOT, source, ignore=leave)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
    run(*pip, "wheel", "--no-deps", "--no-index", "--no-build-isolation", "-w", folder, source, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "venv", symlinks=True)
    programs = folder / "venv" / "bin"
    run(*pip, "--python", programs / "python", "install", "--no-deps", "--no-index", "--no-compile", wheel, cwd=folder)
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    (site / "others.pth").write_text("\n".join(p for p in sys.path if p.endswith("site-packages")) + "\n")
    return programs, site


@pytest.fixture
def elsewhere(tmp_path):
    """A folder that has folders of our names, which nobody must import."""
    for name in ("benchmarks", "integrators", "reference"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('this is somebody else')\n")
    return tmp_path


@pytest.mark.skipif(sys.platform == "win32", reason="programs are elsewhere on Windows")
def test_an_installation_has_all_it_needs(installed, elsewhere):
    programs, site = installed
    assert {p.name for p in site.iterdir() if p.is_dir() and not p.name.endswith((".dist-info", "__pycache__"))} == {
        "phasebench"
    }
    assert "henon-heiles" in run(programs / "phasebench", "list", "problems", cwd=elsewhere)
    import phasebench as pb

    expected = pb.integrate("pendulum", "stormer-verlet", h=0.1, t_end=1).q[-1][0]
    assert float(run(programs / "python", "-c", USE.format(site=str(site)), cwd=elsewhere)) == expected
