"""What README and CONTRIBUTING say is so: commands are run or parsed, code runs, files exist."""

from __future__ import annotations

import importlib.util
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = {name: (ROOT / name).read_text() for name in ("README.md", "CONTRIBUTING.md")}
BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
#: Commands that take more than a few seconds are parsed, not run.
LONG = ("run", "report", "certify", "audit", "compare", "advise", "workprecision")
#: What an example writes or reads, and no file of the project.
OWN = ("my_step.py", "my_problem.py", "test_my_step.py")


def blocks(language: str) -> list[str]:
    return [m[3] for text in DOCUMENTS.values() for m in BLOCK.finditer(text) if m[2] == language]


LINES = [line.strip() for block in blocks("sh") for line in block.splitlines() if line.strip()]
COMMANDS = [shlex.split(part) for line in LINES for part in line.split("&&")]


def named(words: tuple[str, ...]) -> list[list[str]]:
    """The commands that begin with these words, without them."""
    return [c[len(words) :] for c in COMMANDS if tuple(c[: len(words)]) == words]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the files that the documents show."""
    for code in blocks("python"):
        name = re.match(r'"""(\w+\.py):', code)
        if name:
            (tmp_path / name[1]).write_text(code)
    assert {p.name for p in tmp_path.iterdir()} == set(OWN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_block_has_a_language_that_is_tested():
    for text in DOCUMENTS.values():
        assert {m[2] for m in BLOCK.finditer(text)} <= {"sh", "python", "diff", "yaml"}
        assert text.count("```") == 2 * len(BLOCK.findall(text))
    known = [("phasebench",), ("pytest",), ("ruff",), ("python", "-m"), ("python", "tests/mutation")]
    assert all(any(tuple(c[: len(k)]) == k for k in known) for c in COMMANDS)
    assert len(COMMANDS) > 20


@pytest.mark.parametrize("arguments", named(("phasebench",)), ids=" ".join)
def test_a_command_does_what_is_said(arguments, folder):
    if arguments[0] in LONG:
        command = typer.main.get_command(app).commands[arguments[0]]
        assert command.make_context(arguments[0], arguments[1:])
        return
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.strip()


def test_control_a_wrong_command_is_seen(folder):
    command = typer.main.get_command(app).commands["run"]
    with pytest.raises(Exception, match="No such option"):
        command.make_context("run", ["--scenery", "x"])
    assert CliRunner().invoke(app, ["integrate", "pendulum", "./none.py", "--h", "1", "--steps", "1"]).exit_code == 2


@pytest.mark.parametrize("code", blocks("python"), ids=lambda code: code.split("\n")[0])
def test_code_runs(code, folder):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert bool(done.stdout) == ("print(" in code)


@pytest.mark.parametrize("arguments", named(("pytest",)), ids=" ".join)
def test_what_is_tested_is_there(arguments):
    paths = [a for a in arguments if re.match(r"(tests|benchmarks)\b", a)]
    assert paths
    assert all((ROOT / path).exists() for path in paths)
    options = {a for a in arguments if a.startswith("--")}
    assert options <= set(re.findall(r"--[\w-]+", (ROOT / "benchmarks" / "conftest.py").read_text()))


def test_modules_and_extras_are_there():
    modules = [c[0] for c in named(("python", "-m")) if c[0] != "pip"]
    assert modules
    assert all(importlib.util.find_spec(m) for m in modules)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    installed = [c[-1] for c in named(("python", "-m", "pip", "install"))]
    assert installed
    for target in installed:
        assert target == "." or {*re.fullmatch(r"\.\[([\w,]+)\]", target)[1].split(",")} <= {*extras}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_files_that_are_named_exist(name):
    text = BLOCK.sub("", DOCUMENTS[name])
    paths = {p for code in re.findall(r"`([^`]+)`", text) for p in re.findall(r"^\.?\w+/[\w/.-]*$", code)}
    assert len(paths) >= 4
    assert not [p for p in paths if not (ROOT / p).exists()]
    links = re.findall(r"\]\(([\w/.]+\.md)(?:#([\w-]+))?\)", text)
    for target, section in links:
        heads = re.findall(r"^#+ (.*)$", (ROOT / target).read_text(), re.MULTILINE)
        assert not section or section in {h.lower().replace(" ", "-") for h in heads}
