"""The command line: what holds for every command; lists, the JSON object of `integrate`, `run`, `report` and `cache`.

Commands and options are read from the table of commands, so that a new command is tested by being there.
"""

from __future__ import annotations

import importlib
import importlib.metadata as metadata
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import defaultdict
from fractions import Fraction
from pathlib import Path
from typing import Annotated, NamedTuple, get_args, get_type_hints

import numpy as np
import pytest
import typer

from phasebench.benchmarks.cli import COMMANDS, Entry, app, application, options, shared, spellings
from phasebench.benchmarks.cli.run import _cells
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.integrators import integrate
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS
from support.commands import call, run_json, strict
from support.heavy import HEAVY

ROOT = Path(__file__).resolve().parents[2]

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


def ambiguous(commands) -> tuple[set[str], set[str]]:
    """(options with several meanings: sentences, types or metavars; sentences that describe several options)."""
    meanings, words = defaultdict(set), defaultdict(set)
    for o in shown(commands):
        meanings[o.name].add((o.sentence, o.kind, None if o.name == "--output" else o.metavar))
        words[o.sentence].add(o.name)
    return tuple({key for key, values in found.items() if len(values) > 1} for found in (meanings, words))


def test_an_option_means_the_same_in_all_commands_and_says_what_it_is():
    assert ambiguous(COMMANDS) == (set(), set())
    assert len(shown(COMMANDS)) > 60
    assert [o for o in shown(COMMANDS) if not o.sentence.endswith(".") or (o.kind is bool) != (o.metavar is None)] == []


def test_control_another_word_or_meaning_is_seen():
    def new(
        timeout: Annotated[float, typer.Option(help=f"{options.TIME_LIMIT_HELP} Then it ends.")] = 1.0,
        json: Annotated[str, typer.Option(help="A file of JSON.")] = "",
    ) -> None:
        """Do something else."""

    assert ambiguous(COMMANDS | {"new": Entry(new, "")}) == ({"--json"}, {options.TIME_LIMIT_HELP})


def parse(name: str, *arguments: str) -> dict:
    """The values of a command's parameters for some arguments, and "x" for all that it requires; it is not run."""
    command = typer.main.get_command(app).commands[name]
    required = ["x" for p in command.params if p.required]
    return command.make_context(name, [*required, *arguments]).params


def test_old_spellings_work_and_name_the_new_one(capsys):
    for command, table in spellings.OLD.items():
        known = {o.name for o in shown(COMMANDS) if o.command == command}
        for old, new in table.items():
            assert (old in known, new in known) == (False, True), "the old one is hidden, the new one shown"
            expected = parse(command, new, "1")
            assert capsys.readouterr() == ("", "")
            for arguments in ((old, "1"), (f"{old}=1",)):
                assert parse(command, *arguments) == expected
                printed = capsys.readouterr()
                assert (printed.out, printed.err.count("\n")) == ("", 1)
                assert set(re.findall(r"--[\w-]+", printed.err)) == {old, new}
    for arguments in (["--limits", "1"], ["--time-limit", "1"], ["limit"], ["--", "--limit", "1"]):
        assert spellings.translate(arguments, {"--limit": "--time-limit"}) == (arguments, []), "the control"
    listed = parse("workprecision", "--methods", "pefrl, rk4,")
    assert listed == parse("workprecision", "--method", "pefrl", "--method", "rk4")


# -- every command: help, an example that runs, JSON -------------------------------------------------------------------

#: Command -> commands whose examples write what its own reads.
AFTER = {"report": ("run",), "compare": ("run", "report")}


def example(name: str) -> list[str]:
    """The arguments of the example at the end of a command's help text."""
    code, text, _ = call(name, "--help")
    *_, head, last = (line.strip() for line in text.splitlines() if line.strip())
    program, *arguments = shlex.split(last)
    assert (code, head, program, arguments[0]) == (0, "Example:", "phasebench", name)
    return arguments


@pytest.fixture(scope="module")
def run_example(tmp_path_factory):
    """A function: name of a command -> how its example ended, run once; as JSON where the command takes that."""
    folder, results = tmp_path_factory.mktemp("examples"), {}
    shutil.copy(ROOT / "examples" / "leapfrog.py", folder / "my_step.py")
    for name in ("energies.csv", "elsewhere.csv"):
        shutil.copy(ROOT / "examples" / name, folder)
    takes = {o.command for o in shown(COMMANDS) if o.name == "--json"}

    def run(name: str):
        for before in AFTER.get(name, ()):
            run(before)
        if name == "compare":
            shutil.copytree(folder / "my-report", folder / "old-report", dirs_exist_ok=True)
        if name not in results:
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                patch.setattr(
                    "phasebench.benchmarks.certificate.measures.scenes", lambda chosen: []
                )  # test_place has them
                words = example(name)
                results[name] = call(*words, *(["--json"] if name in takes and "--json" not in words else [])), takes
        return results[name]

    return run


@pytest.mark.parametrize("name", COMMANDS)
def test_example_of_the_help_text_runs(name, run_example, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    if shlex.join(["phasebench", *example(name)]) in (ROOT / "README.md").read_text():
        return  # test_documents.py runs it
    done, takes = run_example(name)
    assert done.exit_code == 0, done.output
    assert strict(done.stdout) if name in takes else done.stdout.strip()
    assert takes >= {*COMMANDS} - {"run", "report", "cite"}, "what prints a table takes --json"


def test_text_and_json_agree():
    for words, keys, form in (
        (("integrate", "kepler", "rk4", *SHORT), ("q", "p"), "{!r}"),
        (("stability", "rk4"), ("limit", "limit"), "{:.10g}"),  # of h omega, and the end of an interval
    ):
        found, text = (call(*words, *more) for more in (("--json",), ()))
        numbers = np.ravel([strict(found.stdout)[key] for key in keys])
        shown = [form.format(x) for x in numbers.tolist()]
        assert all(text.stdout.count(x) >= shown.count(x) for x in shown)


@pytest.mark.lowest
def test_version_option():
    assert call("--version")[:2] == (0, f"phasebench {metadata.version('phasebench')}\n")


LOADED = """
import json, runpy, sys
for arguments in {commands!r}:
    sys.argv = ["phasebench", *arguments]
    try:
        runpy.run_module("phasebench", run_name="__main__")
    except SystemExit:
        pass
print("\\n" + json.dumps([m for m in {heavy!r} if m in sys.modules]))
"""


def printed_and_imported(*commands: tuple[str, ...], **environment: str) -> tuple[list[str], list[str]]:
    """(lines printed, heavy packages and typer imported) by a process that runs these commands."""
    command = [sys.executable, "-c", LOADED.format(commands=commands, heavy=(*HEAVY, "typer"))]
    environment = os.environ | environment
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    *lines, imported = done.stdout.splitlines()
    return lines, json.loads(imported)


def test_lists_and_help_import_no_heavy_package():
    commands = ("list", "methods"), ("list", "problems"), ("list", "peers"), ("--help",)
    assert printed_and_imported(*commands)[1] == ["typer"], "the control: what they do import is seen"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (("integrate", "henon"), "henon-heiles:box"),
        (("workprecision", "pendulum", "--method", "rebound-i"), "rebound-ias15"),
        (("advise", "--time"), "--time-limit"),
    ],
)
def test_shell_completes_names_without_heavy_packages(line, expected):
    asked = {"COMP_WORDS": " ".join(("phasebench", *line)), "COMP_CWORD": str(len(line))}
    found, imported = printed_and_imported((), **asked, _PHASEBENCH_COMPLETE="complete_bash")
    assert expected in found
    assert all(name.startswith(line[-1]) for name in found if name)
    assert imported == ["typer"]


def test_json_has_null_for_what_is_not_finite(capsys):
    shared.print_json({"a": [float("nan"), np.float64("inf"), 1 / 3], "b": {"c": -float("inf")}})
    assert strict(capsys.readouterr().out) == {"a": [None, None, 1 / 3], "b": {"c": None}}


# -- list --------------------------------------------------------------------------------------------------------------

REGISTERED = {
    "methods": [m.id for m in METHODS],
    "problems": [*PROBLEMS, *(orbit for _, _, orbits in PROBLEMS.values() for orbit in orbits)],
    "scenes": [s.id for s in (*SCENES, *QUESTIONS)],
    "peers": [p.id for p in PEERS],
}


@pytest.mark.parametrize("kind", REGISTERED)
def test_list_shows_every_registered_id_and_fits_the_terminal(kind, monkeypatch):
    assert not {*REGISTERED[kind]} - {*re.findall(r"[\w.-]+", call("list", kind, "--all")[1])}
    rows = strict(call("list", kind, "--json")[1])
    heads = []
    for columns in (60, 200):
        monkeypatch.setenv("COLUMNS", str(columns))
        lines = call("list", kind, "--all")[1].splitlines()
        assert max(map(len, lines)) <= columns
        assert {r[kind[:-1]] for r in rows} <= {line.split()[0] for line in lines[2:]}
        heads.append(len(lines[1].split()))
    assert 2 <= heads[0] < heads[1]


def test_list_of_methods_shows_those_that_win_and_the_usual_ones_the_best_first():
    ids = {m.id for m in METHODS}
    shown = [line.split()[:2] for line in call("list", "methods")[1].splitlines()[2:] if line.split()[0] in ids]
    wins = [int(number) for _, number in shown]
    assert {"stormer-verlet", "scheme-v", "rk4"} <= {name for name, _ in shown}
    assert len(shown) == 30 < len(METHODS)
    assert wins == sorted(wins, reverse=True)
    every = {r["method"]: r["wins"] for r in strict(call("list", "methods", "--json")[1])}
    assert list(every) == [m.id for m in METHODS]
    assert max(every.values()) == wins[0] > 0


@pytest.mark.parametrize(
    ("kind", "options", "keep"),
    [
        ("methods", ("--family", "schemes-iv-v"), lambda m: m.family == "schemes_iv_v"),
        ("methods", ("--requires", "separable"), lambda m: "separable" in m.requires),
        ("methods", ("--requires", "nothing"), lambda m: not m.requires),
        ("methods", ("--no-symplectic", "--symmetric"), lambda m: m.symmetric and not m.symplectic),
        ("methods", ("--energy", "round-off", "--order", "2"), lambda m: m.energy == "round-off" and m.order == 2),
        ("methods", ("--order", "99"), lambda m: False),
        ("peers", ("--package", "rebound", "--order", "4"), lambda p: p.package == "rebound" and p.order == 4),
        ("peers", ("--installed", "--package", "heyoka"), lambda p: p.package == "heyoka"),
        ("scenes", ("--problem", "pendulum"), lambda s: s.problem.startswith("pendulum")),
    ],
)
def test_filters_of_lists(kind, options, keep):
    known = {"methods": METHODS, "peers": PEERS, "scenes": (*SCENES, *QUESTIONS)}[kind]
    expected = [x.id for x in known if keep(x)]
    assert [r[kind[:-1]] for r in strict(call("list", kind, *options, "--json")[1])] == expected
    assert len(expected) < len(known)
    assert expected or call("list", kind, *options)[:2] == (0, f"none of the {kind}\n")


def test_list_of_peers_shows_versions_and_how_the_step_is_chosen():
    rows = {r["peer"]: r for r in strict(call("list", "peers", "--json")[1])}
    assert rows["scipy-dop853"]["installed"] == metadata.version("scipy")
    assert {id: "--tol" in r["step"] for id, r in rows.items()} == {p.id: p.adaptive for p in PEERS}


# -- integrate ---------------------------------------------------------------------------------------------------------

CONTRACT = ["problem", "method", "params", "h", "steps", "t", "q", "p", "energy_error", "invariants"]
CONTRACT += ["status", "reason", "counts", "seconds", "relative_energy_error"]
COUNTS = ["steps", "gradient", "hessian", "iterations", "fallbacks"]
SHORT = ("--h", "0.1", "--t-end", "1")


@pytest.mark.lowest
@pytest.mark.parametrize(
    ("name", "id", "options", "more"),
    [
        ("henon-heiles:box", "rk4", ("--q", "0.1,-1/3", "--p", "0,0.25"), {"q0": [0.1, -1 / 3], "p0": [0, 0.25]}),
        ("kepler", "implicit-midpoint", ("--set", "e=0.2"), {}),
        ("pendulum", "scheme-i", ("--param", "lam=1/7"), {"parameters": {"lam": Fraction(1, 7)}}),
    ],
)
def test_json_has_the_contracts_keys_and_the_librarys_numbers(name, id, options, more):
    code, found = run_json(name, id, "--h", "0.03", "--t-end", "2", *options)
    made = problem(name, **({"e": 0.2} if "--set" in options else {}))
    s = integrate(made, id, h=0.03, t_end=2, **more)
    assert (code, list(found), list(found["counts"]), found["status"], found["reason"]) == (
        0,
        CONTRACT,
        COUNTS,
        "ok",
        "",
    )
    assert (found["q"], found["p"]) == (s.q[-1].tolist(), s.p[-1].tolist())
    assert (found["t"], found["h"], found["steps"]) == (s.t[-1], s.h, len(s.t) - 1)
    assert found["counts"] == {k: s.counts[k] for k in COUNTS}
    assert found["params"] == ({"lam": "1/7"} if "parameters" in more else {})
    assert set(found["invariants"]) == set(made.invariants)
    errors = [
        (made.system.H, found["energy_error"]),
        *((e, found["invariants"][n]) for n, e in made.invariants.items()),
    ]
    for expression, error in errors:
        value = made.system.observe(expression, s.q, s.p)
        assert error == {"max": np.abs(value - value[0]).max(), "end": value[-1] - value[0]}
    assert found["q"] != run_json(name, id, "--h", "0.03", "--t-end", "2")[1]["q"], "the control: without the options"


def test_step_is_shortened_to_fit_the_span():
    _, found = run_json("pendulum", "rk4", "--h", "0.332", "--t-end", "1")
    assert (found["steps"], found["h"], found["t"]) == (3, 1 / 3, 1.0)


@pytest.mark.lowest
def test_adaptive_peer_takes_a_tolerance():
    code, found = run_json("kepler", "heyoka", "--t-end", "1", "--tol", "1e-15")
    assert (code, list(found), found["params"]) == (0, CONTRACT, {"tol": 1e-15})
    # A Taylor method follows the tolerance by its order, so the error changes rather than the number of steps.
    _, rough = run_json("kepler", "heyoka", "--t-end", "1", "--tol", "1e-5")
    assert rough["energy_error"]["max"] > 1e3 * max(found["energy_error"]["max"], 1e-16) > 0
    s = integrate(problem("kepler"), "rk4", h=1e-3, t_end=1)
    assert np.abs(np.array(found["q"]) - s.q[-1]).max() < 1e-9


KEPLER = ("kepler", "stormer-verlet", "--q", "1,0", "--h", "0.01", "--t-end", "3")


@pytest.mark.parametrize(
    ("words", "status", "reason"),
    [
        (("harmonic-oscillator", "stormer-verlet", "--h", "0.1", "--t-end", "1000"), "ok", ""),
        (("harmonic-oscillator", "stormer-verlet", "--h", "2.1", "--t-end", "1000"), "unstable", ""),
        (("henon-heiles", "explicit-euler", "--h", "1", "--t-end", "100"), "diverged", " of 100"),
        ((*KEPLER, "--p", "0,0"), "collision", "t = 1.1"),  # at pi / (2 sqrt 2)
        ((*KEPLER, "--p", "0,1"), "ok", ""),
        (("pendulum", "rk4", "--h", "1e-6", "--t-end", "20", "--time-limit", "0.01"), "timeout", ""),
    ],
)
def test_status_of_a_run_and_its_exit_code(words, status, reason):
    code, found = run_json(*words)
    assert (found["status"], code, list(found)) == (status, int(status != "ok"), CONTRACT)
    assert reason in found["reason"]
    assert bool(found["reason"]) is (status != "ok")
    assert np.isfinite([*found["q"], *found["p"], found["energy_error"]["max"]]).all()
    assert found["steps"] > 0
    if status == "diverged":
        assert found["energy_error"]["max"] > 1
        assert status in call("integrate", *words).stdout


@pytest.mark.parametrize("steps", ["2", "100"])
def test_overflowing_energy_is_not_reported_as_conserved(steps):
    """At q = 1e156 the energy overflows a double: an error of 0 would be false."""
    run = ("harmonic-oscillator", "explicit-euler", "--h", "1e3", "--steps", steps, "--q", "1e150")
    code, found = run_json(*run)
    assert found["energy_error"]["max"] is None or found["energy_error"]["max"] > 0
    assert code in (0, 1)


# -- run, report and cache ---------------------------------------------------------------------------------------------

SCENE = next(s for s in SCENES if s.id == "lotka-volterra-t1")
SWEEP = ("--scene", SCENE.id, "--method", "rk4", "--quick")


@pytest.fixture(scope="module")
def swept(tmp_path_factory) -> str:
    """The rows of a small sweep, as JSON lines."""
    path = tmp_path_factory.mktemp("rows") / "rows.jsonl"
    assert call("run", *SWEEP, "--output", str(path))[0] == 0
    return path.read_text()


@pytest.fixture
def again(swept, tmp_path):
    """A function that runs the sweep with these rows stored: (is all of it stored, rows before, rows after)."""

    def run(text: str = swept, words=SWEEP):
        path = tmp_path / "rows.jsonl"
        path.write_text(text)
        done = call("run", *words, "--output", str(path))
        assert done.exit_code == 0
        rows = [[strict(line) for line in x.splitlines()] for x in (swept, path.read_text())]
        return "1 of 1 cells" in done.said, *rows

    return run


def test_rows_of_a_sweep_are_measured_once(again):
    stored, before, after = again()
    assert (stored, before) == (True, after)
    assert [r["h"] for r in after] == list(SCENE.ladder(quick=True))
    assert {(r["scene"], r["id"], r["status"]) for r in after} == {(SCENE.id, "rk4", "ok")}
    stored, before, after = again(words=("--scene", SCENE.id, "--method", "avf", "--quick"))
    assert after[: len(before)] == before, "of another method: these stay"
    assert {r["id"] for r in after} == {"rk4", "avf"}


@pytest.mark.parametrize("line", ["", '{"cell": ', "no row"])
def test_cell_with_an_unreadable_row_is_measured_again(swept, again, line):
    lines = swept.splitlines()
    stored, before, after = again("\n".join([*lines[:1], line, *lines[2:]]) + "\n")
    assert not stored
    timeless = [
        [{k: v for k, v in r.items() if k not in ("seconds", "spent")} for r in rows] for rows in (before, after)
    ]
    assert timeless[0] == timeless[1]


def test_report_of_rows(swept, tmp_path):
    """A sweep with --quick is no full run; rows of one method without an order are reported, too."""
    (tmp_path / "rows.jsonl").write_text(swept)
    folder, site = tmp_path / "report", tmp_path / "site"
    code, text, _ = call("report", "--reports", folder, "--rows", tmp_path / "rows.jsonl", "--html", site)
    assert (code, "index.html" in text) == (0, True)
    assert "lotka-volterra" in (site / "orders.html").read_text()
    assert "full run" not in (folder / "README.md").read_text()


def test_every_listed_scene_has_cells():
    assert {cell.key["scene"] for cell in _cells([], [], False)} == {*REGISTERED["scenes"]}


def test_scene_of_the_trade_off_has_rows_to_round_off(tmp_path):
    path = tmp_path / "rows.jsonl"
    options = ("--scene", "pendulum-short", "--method", "pefrl", "--method", "wisdom-holman", "--output", path)
    assert call("run", *options)[0] == 0
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    errors = [r["error"] for r in rows if r["status"] == "ok"]
    assert min(errors) < 1e-10 < 1e-3 < max(errors)
    assert [r["status"] for r in rows if r["method"] == "wisdom-holman"] == ["skipped"]
    code, _, said = call("report", "--reports", tmp_path / "report", "--rows", path)
    assert (code, "no page" in said) == (2, True)


def test_cache_shows_its_folder_and_is_cleared(tmp_path, monkeypatch):
    from phasebench.integrators.compile import cache

    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    cache.write("a.py", bytes(1000))
    state = strict(call("cache", "--json")[1])
    assert (state["folder"], state["entries"], state["other_versions"]) == (str(tmp_path), 1, 0)
    assert 1000 < state["bytes"] < 1200
    assert strict(call("cache", "--clear", "--json")[1])["entries"] == 0
    assert not list(tmp_path.iterdir())


def test_cache_builds_kernels_and_reports_failures(tmp_path, monkeypatch):
    from phasebench.integrators import driver
    from phasebench.integrators.compile import cache, codegen
    from phasebench.integrators.stepping import kernel

    command = importlib.import_module("phasebench.benchmarks.cli.cache")
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    monkeypatch.setattr(codegen, "_ready", {})  # as in a new process
    monkeypatch.setattr(kernel, "_kernels", {})
    todo = command.tasks()
    small = {name for name in PROBLEMS if problem(name).system.d <= command.LARGEST}
    assert {name for _, _, names in todo for name in names} == small
    assert {f for f, _, _ in todo} == {m.family for m in METHODS}
    done, failures = command.made(("splitting", 1, ("pendulum",)))
    assert (done > 1, failures) == (True, [])
    assert any(path.name.startswith("splitting-") for path in cache.folder().iterdir())
    monkeypatch.setattr(driver, "warm", lambda *_, **__: 1 / 0)
    done, failures = command.made(("splitting", 1, ("pendulum",)))
    assert (done, all("ZeroDivisionError" in line for line in failures)) == (0, True)
    monkeypatch.setattr(command, "_in_processes", lambda todo, jobs: iter([(1, []), (0, ["a on b: no"])]))
    complaint = call("cache", "--build")
    assert (complaint.exit_code, "a on b: no" in complaint.said) == (1, True)
