"""README and CONTRIBUTING are correct: their commands run or parse, their code runs, the files they name exist."""

from __future__ import annotations

import importlib.util
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

from phasebench.benchmarks.cli import app
from support.commands import call

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = {name: (ROOT / name).read_text() for name in ("README.md", "CONTRIBUTING.md")}
BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
#: Slow commands: they are parsed, not run.
LONG = ("run", "report", "certify", "audit", "compare", "advise", "validate", "workprecision")


def blocks(language: str) -> list[str]:
    """Code blocks of a language in both documents."""
    return [m[3] for text in DOCUMENTS.values() for m in BLOCK.finditer(text) if m[2] == language]


SHOWN = [line.removeprefix("$ ") for block in blocks("console") for line in block.splitlines() if line.startswith("$ ")]
LINES = [line.strip() for block in blocks("sh") for line in block.splitlines() if line.strip()] + SHOWN
COMMANDS = [shlex.split(part) for line in LINES for part in line.split("&&")]


def commands_of(words: tuple[str, ...]) -> list[list[str]]:
    """Arguments of the commands that begin with these words."""
    return [c[len(words) :] for c in COMMANDS if tuple(c[: len(words)]) == words]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Temporary folder, made current, with the examples beside it as in a checkout."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_block_has_a_language_that_is_tested():
    for text in DOCUMENTS.values():
        assert {m[2] for m in BLOCK.finditer(text)} <= {"sh", "console", "python", "diff"}
        assert text.count("```") == 2 * len(BLOCK.findall(text))
    known = [("phasebench",), ("pytest",), ("ruff",), ("python", "-m"), ("cosmic-ray",), ("cr-report",)]
    assert all(any(tuple(c[: len(k)]) == k for k in known) for c in COMMANDS)
    assert len(COMMANDS) > 15
    assert blocks("python")
    changed = [file for block in blocks("diff") for file in re.findall(r"^\+\+\+ b/(.*)$", block, re.MULTILINE)]
    assert changed
    assert all((ROOT / file).exists() for file in changed)


@pytest.mark.parametrize("arguments", commands_of(("phasebench",)), ids=" ".join)
def test_commands_of_the_documents_run(arguments, folder):
    if arguments[0] in LONG:
        command = typer.main.get_command(app).commands[arguments[0]]
        assert command.make_context(arguments[0], arguments[1:])
        return
    result = call(*arguments)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.strip()


def test_output_in_readme_is_what_the_command_prints():
    """Of the one command in the README whose output holds no time."""
    refresh = runpy.run_path(str(ROOT / "docs" / "readme.py"))
    (stability,) = (b[0] for b in refresh["BLOCK"].finditer(DOCUMENTS["README.md"]) if "stability" in b[1])
    wrong = stability.replace("3.13", "3.14")
    assert refresh["refreshed"](wrong) == stability != wrong


def test_numbers_of_the_paper_are_those_of_the_pages():
    paper = (ROOT / "docs" / "paper" / "paper.md").read_text(encoding="utf-8")
    answered = runpy.run_path(str(ROOT / "docs" / "readme.py"))["answered"]
    assert answered(paper) == paper
    wrong = re.sub(r"\d+ of \d+", "1 of 2", paper)
    assert answered(wrong) == paper != wrong
    assert len(re.sub(r"<!--.*?-->|^---.*?^---", "", paper, flags=re.DOTALL | re.MULTILINE).split()) <= 1000


def test_readme_fits_a_screen_or_two():
    assert len(DOCUMENTS["README.md"].splitlines()) <= 110


def test_control_a_wrong_option_is_seen():
    with pytest.raises(Exception, match="No such option"):
        typer.main.get_command(app).commands["run"].make_context("run", ["--scenery", "x"])


@pytest.mark.parametrize("code", blocks("python"), ids=lambda code: code.split("\n")[0])
def test_code_of_the_documents_runs(code, folder):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert bool(done.stdout) == ("print(" in code)


@pytest.mark.parametrize("arguments", commands_of(("pytest",)), ids=" ".join)
def test_pytest_commands_name_existing_files_and_options(arguments):
    paths = [a for a in arguments if re.match(r"(tests|benchmarks)\b", a)]
    assert paths
    assert all((ROOT / path).exists() for path in paths)
    options = {a for a in arguments if a.startswith("--")}
    assert options <= set(re.findall(r"--[\w-]+", (ROOT / "benchmarks" / "conftest.py").read_text()))


def test_modules_and_extras_exist():
    modules = {c[0] for c in commands_of(("python", "-m"))} - {"pip", "sphinx"}
    assert modules
    assert [m for m in modules if not importlib.util.find_spec(m)] == []
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    installed = [c[-1] for c in commands_of(("python", "-m", "pip", "install"))]
    assert installed
    for target in installed:
        assert target in (".", "cosmic-ray") or {*re.fullmatch(r"\.\[([\w,]+)\]", target)[1].split(",")} <= {*extras}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_named_files_exist(name):
    text = BLOCK.sub("", DOCUMENTS[name])
    paths = {p for code in re.findall(r"`([^`]+)`", text) for p in re.findall(r"^\.?\w+/[\w/.-]*$", code)}
    assert paths
    assert not [p for p in paths if not (ROOT / p).exists()]
    links = re.findall(r"\]\(([\w/.-]+)(?:#([\w-]+))?\)", text)
    assert links
    for target, section in links:
        assert (ROOT / target).exists()
        if section:
            heads = re.findall(r"^#+ (.*)$", (ROOT / target).read_text(), re.MULTILINE)
            assert section in {h.lower().replace(" ", "-") for h in heads}
