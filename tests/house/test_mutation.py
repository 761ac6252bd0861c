"""The command that changes the suite: its mutants change what a module does, one place each."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("cosmic_ray", reason="of the extra 'mutation'")
TOOL = Path(__file__).parents[1] / "mutation"

CODE = '''"""A module."""

LEAST = 3


def few(x: list | None, y=0):
    """Whether there are few."""
    if x is None or y:
        return True
    return min(len(x), 9) < LEAST - 1


def draw(x):
    return x + 1
'''


@pytest.fixture
def mutants(tmp_path, monkeypatch):
    (tmp_path / "module.py").write_text(CODE)
    monkeypatch.syspath_prepend(TOOL)
    import mutants as module

    return module.mutants(tmp_path, "module.py"), tmp_path


def test_every_kind_of_change_is_made_once_and_none_of_what_does_nothing(mutants):
    found, root = mutants
    changed = {"".join(m.after.split()) for m in found}
    expected = {
        "LEAST = 4",
        "def few(x: list | None, y=1):",
        "if x is not None or y:",
        "if x is None and y:",
        "return False",
        "return max(len(x), 9) < LEAST - 1",
        "return min(len(x), 9) <= LEAST - 1",
        "return min(len(x), 9) >= LEAST - 1",
        "return min(len(x), 9) < LEAST + 1",
    }
    assert {"".join(line.split()) for line in expected} <= changed
    assert not any("list&" in line or "x-1" in line for line in changed), "an annotation or a figure was changed"
    codes = [m.code(root) for m in found]
    assert len({CODE, *codes}) == 1 + len(codes)
    assert {m.where for m in found} == {"", "few"}
    assert all(CODE.splitlines()[m.line - 1].strip() == m.before for m in found)


def test_the_command_says_what_it_takes():
    said = subprocess.run([sys.executable, TOOL, "--help"], capture_output=True, text=True, check=True).stdout
    assert all(option in said for option in ("--reach", "--sample", "--seed", "--jobs"))
