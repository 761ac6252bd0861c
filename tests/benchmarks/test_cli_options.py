"""Options of the command line: one word for one thing, old spellings, examples of the help texts, completion.

Everything is read from the table of commands, so that a new command is tested by being there.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Annotated, NamedTuple, get_args, get_type_hints

import pytest
import typer

from phasebench.benchmarks import conftest
from phasebench.benchmarks.advice import ask
from phasebench.benchmarks.cli import COMMANDS, Entry, app, application, completion, options, spellings
from support.commands import call
from support.heavy import HEAVY

ROOT = Path(__file__).resolve().parents[2]
#: Command -> commands whose examples write what its own reads.
AFTER = {"report": ("run",), "compare": ("run", "report")}
SPELLINGS = [(command, old, new) for command, table in spellings.OLD.items() for old, new in table.items()]


# -- one word for one thing --------------------------------------------------------------------------------------------


class Option(NamedTuple):
    """An option that a command's help text shows: its name, the first sentence of its help, its type, its metavar."""

    command: str
    name: str
    sentence: str
    kind: type
    metavar: str | None


def shown(commands) -> list[Option]:
    found = []
    for command, made in typer.main.get_command(application(commands)).commands.items():
        hints = get_type_hints(commands[command].run)
        for p in made.params:
            if p.param_type_name == "option" and not p.hidden and p.name in hints:
                kinds = [x for x in get_args(hints[p.name]) if x is not type(None)] or [hints[p.name]]
                sentence = re.split(r"(?<=\.)\s", p.help or "")[0]
                found.append(Option(command, p.opts[0], sentence, kinds[0], p.metavar))
    return found


def meanings(commands) -> dict[str, set]:
    """Option -> its meanings: first sentence, type and metavar (of --output a file or a folder)."""
    found = defaultdict(set)
    for o in shown(commands):
        found[o.name].add((o.sentence, o.kind, None if o.name == "--output" else o.metavar))
    return found


def words(commands) -> dict[str, set]:
    """First sentence -> the options that it describes."""
    found = defaultdict(set)
    for o in shown(commands):
        found[o.sentence].add(o.name)
    return found


def several(found: dict[str, set]) -> dict[str, set]:
    return {key: values for key, values in found.items() if len(values) > 1}


def test_an_option_means_the_same_in_all_commands():
    assert len(meanings(COMMANDS)) > 30
    assert several(meanings(COMMANDS)) == {}


def test_two_options_do_not_mean_the_same():
    assert several(words(COMMANDS)) == {}


def test_control_another_word_or_meaning_is_seen():
    def new(
        timeout: Annotated[float, typer.Option(help=f"{options.TIME_LIMIT_HELP} Then it ends.")] = 1.0,
        json: Annotated[str, typer.Option(help="A file of JSON.")] = "",
    ) -> None:
        """Do something else."""

    wider = COMMANDS | {"new": Entry(new, "")}
    assert several(words(wider)) == {options.TIME_LIMIT_HELP: {"--timeout", "--time-limit"}}
    assert set(several(meanings(wider))) == {"--json"}


def test_every_parameter_says_what_it_is():
    """Each help text is a sentence; exactly the options that are no flags show what kind of value they take."""
    for name, command in typer.main.get_command(app).commands.items():
        for p in command.params:
            assert (p.help or "").endswith("."), f"{name} {p.name}"
    assert [o for o in shown(COMMANDS) if (o.kind is bool) != (o.metavar is None)] == []


def test_default_time_of_a_search_is_the_one_that_help_says():
    (help,) = (p.help for p in typer.main.get_command(app).commands["advise"].params if p.name == "time_limit")
    assert [float(x) for x in re.findall(r"\d+", help)] == [ask.STORED, ask.NEW]


def test_options_of_pytest_are_flags_where_the_commands_have_flags():
    class Group:
        flags: dict[str, bool] = {}  # noqa: RUF012

        def getgroup(self, name):
            return self

        def addoption(self, name, action="store", **_):
            self.flags[name] = action == "store_true"

    conftest.pytest_addoption(Group())
    kinds = {o.name: o.kind for o in shown(COMMANDS)}
    both = Group.flags.keys() & kinds
    assert {"--quick", "--all", "--scheduler", "--reports", "--seed", "--budget"} <= both
    assert {x: Group.flags[x] for x in both} == {x: kinds[x] is bool for x in both}
    assert not Group.flags.keys() & {old for _, old, _ in SPELLINGS}


# -- old spellings -----------------------------------------------------------------------------------------------------


def parse(name: str, *arguments: str) -> dict:
    """The values of a command's parameters for some arguments, and "x" for all that it requires; it is not run."""
    command = typer.main.get_command(app).commands[name]
    required = ["x" for p in command.params if p.required]
    return command.make_context(name, [*required, *arguments]).params


@pytest.mark.parametrize(("command", "old", "new"), SPELLINGS)
def test_old_spelling_works_and_names_the_new_one(command, old, new, capsys):
    known = {o.name for o in shown(COMMANDS) if o.command == command}
    assert (old in known, new in known) == (False, True), "the old one is hidden, the new one shown"
    expected = parse(command, new, "1")
    assert capsys.readouterr() == ("", "")
    for arguments in ((old, "1"), (f"{old}=1",)):
        assert parse(command, *arguments) == expected
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        assert set(re.findall(r"--[\w-]+", printed.err)) == {old, new}


def test_list_with_commas_becomes_repeated_options(capsys):
    old = parse("workprecision", "--methods", "pefrl, rk4,")
    assert old == parse("workprecision", "--method", "pefrl", "--method", "rk4")
    assert capsys.readouterr().err.count("--methods is now --method") == 1


def test_control_values_and_words_after_two_dashes_stay(capsys):
    table = {"--limit": "--time-limit"}
    for arguments in (["--limits", "1"], ["--time-limit", "1"], ["limit"], ["--", "--limit", "1"]):
        assert spellings.translate(arguments, table) == (arguments, [])
    with pytest.raises(Exception, match="No such option"):
        parse("stability", "--timeout", "1")


def test_old_spelling_changes_neither_exit_code_nor_json():
    line = ("integrate", "pendulum", "rk4", "--h", "0.1", "--t-end", "1", "--json")
    (code, new, silent), (old_code, old, notice) = call(*line, "--time-limit", "9"), call(*line, "--timeout", "9")
    assert (code, old_code, silent, notice) == (0, 0, "", "--timeout is now --time-limit\n")
    found = [json.loads(text) | {"seconds": None} for text in (new, old)]
    assert found[0] == found[1]


# -- files -------------------------------------------------------------------------------------------------------------


def test_ending_of_the_output_says_its_kind(tmp_path):
    span = ("--t-end", "1")
    for line, wrong in [
        (("integrate", "pendulum", "rk4", "--h", "0.1", *span), "rows.jsonl"),
        (("run", "pendulum", *span, "--method", "rk4"), "rows.csv"),
        (("workprecision", "pendulum", *span), "figure.csv"),
    ]:
        code, _, said = call(*line, "--output", str(tmp_path / wrong))
        assert code == 2
        assert wrong in said
    assert not list(tmp_path.iterdir())


# -- examples ----------------------------------------------------------------------------------------------------------


def example(name: str) -> list[str]:
    """The arguments of the example at the end of a command's help text."""
    code, text, _ = call(name, "--help")
    *_, head, last = (line.strip() for line in text.splitlines() if line.strip())
    assert (code, head) == (0, "Example:")
    program, *arguments = shlex.split(last)
    assert program == "phasebench"
    return arguments


@pytest.fixture(scope="module")
def run_example(tmp_path_factory):
    """A function: name of a command -> (exit code, output) of its example, run once in a folder of this module."""
    folder, results = tmp_path_factory.mktemp("examples"), {}
    shutil.copy(ROOT / "examples" / "leapfrog.py", folder / "my_step.py")
    for name in ("energies.csv", "elsewhere.csv"):
        shutil.copy(ROOT / "examples" / name, folder)

    def run(name: str):
        for before in AFTER.get(name, ()):
            run(before)
        if name == "compare":
            shutil.copytree(folder / "my-report", folder / "old-report", dirs_exist_ok=True)
        if name not in results:
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                results[name] = call(*example(name))[:2]
        return results[name]

    return run


@pytest.mark.parametrize("name", COMMANDS)
def test_example_of_the_help_text_runs(name, run_example, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    arguments = example(name)
    assert arguments[0] == name
    assert len(arguments) > 1
    if shlex.join(["phasebench", *arguments]) in (ROOT / "README.md").read_text():
        return  # test_documents.py runs it
    code, text = run_example(name)
    assert code == 0
    assert text.strip()


def test_control_example_that_fails_or_is_cut_is_seen(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    with pytest.raises(AssertionError):
        example("workprecision")
    assert call("integrate", "pendulum", "--time", "1")[0] == 2


# -- completion --------------------------------------------------------------------------------------------------------

COMPLETED = f"""
import json, sys
from phasebench.benchmarks.cli import main
sys.argv = ["phasebench"]
try:
    main()
except SystemExit:
    pass
print(json.dumps([m for m in {HEAVY!r} if m in sys.modules]))
"""


def complete(*line: str):
    """(completions of the last word as a shell asks for them, heavy packages imported)."""
    asked = {"COMP_WORDS": " ".join(("phasebench", *line)), "COMP_CWORD": str(len(line))}
    environment = os.environ | asked | {"_PHASEBENCH_COMPLETE": "complete_bash"}
    command = [sys.executable, "-c", COMPLETED]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    *found, imported = done.stdout.split("\n")[:-1]
    return found, json.loads(imported)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (("integ",), "integrate"),
        (("integrate", "henon"), "henon-heiles:box"),
        (("integrate", "pendulum", "stormer"), "stormer-verlet"),
        (("workprecision", "pendulum", "--method", "rebound-i"), "rebound-ias15"),
        (("audit", "--peer", "rebound-l"), "rebound-leapfrog"),
        (("advise", "--time"), "--time-limit"),
    ],
    ids=lambda x: " ".join(x) if isinstance(x, tuple) else x,
)
def test_shell_completes_names_without_heavy_packages(line, expected):
    found, imported = complete(*line)
    assert expected in found
    assert all(name.startswith(line[-1]) for name in found)
    assert imported == []


def test_control_no_completion_of_an_unknown_name():
    assert completion.methods_and_peers("nosuch") == completion.problems("nosuch") == []
    assert completion.methods_and_problems("nosuch") == []


def test_completion_can_be_installed():
    result = call("--help")
    assert {"--install-completion", "--show-completion", "--version"} <= set(re.findall(r"--[\w-]+", result.stdout))
