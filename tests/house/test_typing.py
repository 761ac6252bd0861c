"""A type checker sees the public face: right use passes, each line of misuse is reported, exports match the imports."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import phasebench as pb

ROOT = Path(__file__).resolve().parents[2]
FILES = ROOT / "tests" / "typing"
RIGHT, WRONG = "right.py", "wrong.py"


@pytest.fixture(scope="module")
def errors(tmp_path_factory, request):
    """The lines of errors that mypy --strict reports in each of the files, in a folder as a user's."""
    if find_spec("mypy") is None:
        pytest.skip("mypy is not installed")
    folder = tmp_path_factory.mktemp("typing")
    for name in (RIGHT, WRONG):
        shutil.copy(FILES / name, folder)
    cache = str(request.config.cache.mkdir("mypy"))  # the next run takes seconds
    line = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", cache, RIGHT, WRONG]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)
    found: dict[str, set[int]] = {RIGHT: set(), WRONG: set()}
    for name, number in re.findall(r"^(.+?):(\d+): error:", done.stdout, re.MULTILINE):
        found[name].add(int(number))
    return found


def test_right_use_passes_a_strict_type_check(errors):
    assert errors[RIGHT] == set()


def test_each_line_of_misuse_is_an_error_of_type(errors):
    lines = (FILES / WRONG).read_text().splitlines()
    marked = {number for number, line in enumerate(lines, 1) if line.endswith("# wrong")}
    assert len(marked) > 20
    assert errors[WRONG] == marked


def test_types_are_imported_for_every_public_name():
    tree = ast.parse((ROOT / "phasebench" / "__init__.py").read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If) and getattr(n.test, "id", "") == "TYPE_CHECKING")
    imports = {a.asname: f"{n.module}.{a.name}" for n in block.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert sorted(imports) == pb.__all__
    for name, path in imports.items():
        module = __import__(path.rpartition(".")[0], fromlist=["_"])
        assert getattr(module, name) is getattr(pb, name), name


def test_import_loads_neither_typing_nor_numpy():
    line = "import sys; import phasebench; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-S", "-c", line], capture_output=True, text=True, check=True, cwd=ROOT)
    assert not {"typing", "numpy", "pandas", "matplotlib", "sympy"} & {*done.stdout.split()}
