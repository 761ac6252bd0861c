"""A wheel works when installed, even beside a folder named ``benchmarks``, and contains every file."""

from __future__ import annotations

import importlib.metadata
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Oldest setuptools that reads the licence field of pyproject.toml.
SETUPTOOLS = 77
#: Script that reads every kind of data file of the package through the code that uses it.
USE = """
import phasebench as pb
from phasebench.benchmarks import bibliography
from phasebench.benchmarks.advice import prior
from phasebench.benchmarks.certificate import fronts
from phasebench.integrators import coefficients
from phasebench.benchmarks.store import error_tables
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.reference.certificates import stored
from pathlib import Path

assert Path(pb.__file__).is_relative_to({site!r}), pb.__file__
s = pb.integrate("pendulum", "stormer-verlet", h=0.1, t_end=1)
assert s.status == "ok"
assert coefficients.polished_numbers("pefrl")
assert bibliography.bibtex(["pefrl", "pendulum"])
assert stored.load(pb.problem("pendulum"))
assert all(len(error_tables.load(s.id)[0]) for s in SCENES)
assert prior.TABLE.load().factors
assert fronts.TABLE.load()
print(s.q[-1][0])
"""


def run(*command, cwd) -> str:
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check")


def build_wheel(folder: Path, links: bool) -> Path:
    """The wheel of a copy of this tree; without ``links`` its symbolic links are files, as Windows checks them out."""
    source = folder / "source"
    leave = shutil.ignore_patterns(".*", "__pycache__", "reports", "tests", "build", "*.egg-info")
    shutil.copytree(ROOT, source, ignore=leave, symlinks=True)
    for link in () if links else [p for p in (source / "phasebench").iterdir() if p.is_symlink()]:
        target = link.readlink()
        link.unlink()
        link.write_text(target.as_posix())
    run(*PIP, "wheel", "--no-deps", "--no-index", "--no-build-isolation", "-w", folder, source, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module", params=[True, False], ids=["links", "no links"])
def installation(request, tmp_path_factory) -> tuple[Path, Path]:
    """Paths (programs, site-packages) of an environment with a wheel of this tree and this environment's packages."""
    try:
        if int(importlib.metadata.version("setuptools").split(".")[0]) < SETUPTOOLS:
            pytest.skip(f"setuptools is older than {SETUPTOOLS}")
        importlib.metadata.version("pip")
    except importlib.metadata.PackageNotFoundError as error:
        pytest.skip(f"{error.name} is not installed, and a test fetches nothing")
    folder = tmp_path_factory.mktemp("installation")
    wheel = build_wheel(folder, request.param)
    venv.create(folder / "venv", symlinks=True)
    programs = folder / "venv" / "bin"
    run(*PIP, "--python", programs / "python", "install", "--no-deps", "--no-index", "--no-compile", wheel, cwd=folder)
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    (site / "others.pth").write_text("\n".join(p for p in sys.path if p.endswith("site-packages")) + "\n")
    return programs, site


@pytest.fixture
def elsewhere(tmp_path):
    """Folder with packages named like ours that raise ImportError when imported."""
    for name in ("benchmarks", "integrators", "reference"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('this is somebody else')\n")
    return tmp_path


@pytest.mark.skipif(sys.platform == "win32", reason="programs are elsewhere on Windows")
def test_an_installation_is_complete(installation, elsewhere):
    programs, site = installation
    assert {p.name for p in site.iterdir() if p.is_dir() and not p.name.endswith((".dist-info", "__pycache__"))} == {
        "phasebench"
    }
    assert "henon-heiles" in run(programs / "phasebench", "list", "problems", cwd=elsewhere)
    import phasebench as pb

    expected = pb.integrate("pendulum", "stormer-verlet", h=0.1, t_end=1).q[-1][0]
    assert float(run(programs / "python", "-c", USE.format(site=str(site)), cwd=elsewhere)) == expected


def files(folder: Path) -> set[str]:
    """Relative paths of the files below a folder, without documentation and bytecode."""
    found = (p for p in folder.rglob("*") if p.is_file() and p.suffix != ".md" and "__pycache__" not in p.parts)
    return {p.relative_to(folder.parent).as_posix() for p in found}


def test_an_installation_has_every_file(installation):
    house = files(ROOT / "integrators") | files(ROOT / "reference") | files(ROOT / "benchmarks")
    expected = {f"phasebench/{name}" for name in (*house, "__init__.py", "__main__.py", "py.typed")}
    assert files(installation[1] / "phasebench") == expected
