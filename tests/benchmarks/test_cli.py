"""The command line: lists, the JSON object of ``integrate``, exit codes, ``run`` and ``report``."""

from __future__ import annotations

import importlib
import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from phasebench.benchmarks.cli import shared
from phasebench.benchmarks.cli.integrate import shortened
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.integrators import integrate, registry
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS
from support.commands import call, run_json, strict
from support.heavy import HEAVY

ROOT = Path(__file__).resolve().parents[2]
REGISTERED = {
    "methods": [m.id for m in METHODS],
    "problems": [*PROBLEMS, *(orbit for _, _, orbits in PROBLEMS.values() for orbit in orbits)],
    "scenes": [s.id for s in (*SCENES, *QUESTIONS)],
    "peers": [p.id for p in PEERS],
}
CONTRACT = ["problem", "method", "params", "h", "steps", "t", "q", "p", "energy_error", "invariants"]
CONTRACT += ["status", "reason", "counts", "seconds", "relative_energy_error"]
COUNTS = ["steps", "gradient", "hessian", "iterations", "fallbacks"]
SHORT = ("--h", "0.1", "--t-end", "1")


# -- list --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", REGISTERED)
def test_list_shows_every_registered_id(kind):
    code, text, _ = call("list", kind)
    assert code == 0
    assert not set(REGISTERED[kind]) - set(re.findall(r"[\w.-]+", text))


def test_control_unknown_id_is_not_listed():
    assert "rk5" not in re.findall(r"[\w.-]+", call("list", "methods")[1])


def test_unstable_run_exits_with_an_error():
    for h, status in (("2.1", "unstable"), ("0.1", "ok")):
        code, found = run_json("harmonic-oscillator", "stormer-verlet", "--h", h, "--t-end", "1000")
        assert (found["status"], code == 0) == (status, status == "ok")


def test_run_from_a_later_time_back_to_0_returns():
    run = ("pendulum", "stormer-verlet", "--h", "0.1")
    there = run_json(*run, "--t-end", "2")[1]
    state = (f"--q={there['q'][0]!r}", f"--p={there['p'][0]!r}")
    code, back = run_json(*run, "--t0", "2", "--t-end", "0", *state)
    assert (code, back["t"], back["steps"], back["h"]) == (0, 0.0, 20, -0.1)
    assert [*back["q"], *back["p"]] == pytest.approx([*problem("pendulum").q0, *problem("pendulum").p0], abs=1e-12)


def test_unknown_list_is_an_error():
    assert call("list", "planets")[0] == 2


REGISTRY = "phasebench.integrators.registry"
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


def imported_packages(*commands: tuple[str, ...], heavy=HEAVY):
    """The packages in ``heavy`` that one process has imported after running the commands."""
    code = LOADED.format(commands=commands, heavy=heavy)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("columns", [60, 80, 100, 200])
@pytest.mark.parametrize("kind", REGISTERED)
def test_list_fits_the_terminal(kind, columns, monkeypatch):
    """No line is too long, ids are not cut, and at least two columns are shown."""
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = call("list", kind)[1].splitlines()
    assert max(map(len, lines)) <= columns
    shown = {line.split()[0] for line in lines[2:]}
    assert {r[kind[:-1]] for r in strict(call("list", kind, "--json")[1])} <= shown
    assert len(lines[1].split()) >= 2


def test_wider_terminal_shows_more_columns(monkeypatch):
    heads = {}
    for columns in (60, 80, 120, 1000):
        monkeypatch.setenv("COLUMNS", str(columns))
        text = call("list", "methods")[1]
        title, head, *_ = text.splitlines()
        heads[columns] = head.split()
        assert title.split() == [str(len(METHODS)), "methods"]
        assert ("everything with --json" in " ".join(text.split())) == (columns < 1000)
    assert len(heads[60]) < len(heads[80]) < len(heads[120]) < len(heads[1000])
    assert heads[80][:3] == ["method", "order", "family"]
    assert {"name", "source"} <= set(heads[1000])


FILTERS = [
    ("methods", ("--order", "4"), lambda m: m.order == 4),
    ("methods", ("--family", "splitting"), lambda m: m.family == "splitting"),
    ("methods", ("--family", "schemes-iv-v"), lambda m: m.family == "schemes_iv_v"),
    ("methods", ("--requires", "separable"), lambda m: "separable" in m.requires),
    ("methods", ("--requires", "nothing"), lambda m: not m.requires),
    ("methods", ("--symplectic",), lambda m: m.symplectic),
    ("methods", ("--no-symplectic", "--symmetric"), lambda m: m.symmetric and not m.symplectic),
    ("methods", ("--energy", "round-off", "--order", "2"), lambda m: m.energy == "round-off" and m.order == 2),
    ("peers", ("--package", "rebound", "--order", "4"), lambda p: p.package == "rebound" and p.order == 4),
    ("peers", ("--installed", "--package", "heyoka"), lambda p: p.package == "heyoka"),
    ("scenes", ("--problem", "pendulum"), lambda s: s.problem.startswith("pendulum")),
]


@pytest.mark.parametrize(
    ("kind", "options", "keep"), FILTERS, ids=lambda x: " ".join(x) if isinstance(x, tuple) else ""
)
def test_filters_of_lists(kind, options, keep):
    known = {"methods": METHODS, "peers": PEERS, "scenes": (*SCENES, *QUESTIONS)}[kind]
    expected = [x.id for x in known if keep(x)]
    rows = strict(call("list", kind, *options, "--json")[1])
    assert [r[kind[:-1]] for r in rows] == expected
    assert 0 < len(expected) < len(known)


def test_empty_and_invalid_filters():
    code, text, _ = call("list", "methods", "--order", "99")
    assert (code, text) == (0, "none of the methods\n")
    assert call("list", "methods", "--order", "99", "--json")[1] == "[]\n"
    code, text, _ = call("list", "peers", "--order", "4", "--package", "heyoka")
    assert (code, text) == (0, "none of the peers\n")
    for arguments, message in [
        (("methods", "--order", "99", "--package", "x"), "--package is no option of methods"),
        (("methods", "--family", "spliting"), "did you mean splitting"),
        (("methods", "--requires", "seperable"), "did you mean separable"),
        (("methods", "--package", "rebound"), "--package is no option of methods"),
        (("problems", "--order", "2"), "--order is no option of problems"),
        (("problems", "--problem", "kepler"), "--problem is no option of problems"),
    ]:
        done = call("list", *arguments)
        assert done.exit_code == 2
        assert message in done.said


def test_list_of_peers_shows_installed_versions(monkeypatch):
    import importlib.metadata as metadata

    rows = {r["peer"]: r for r in strict(call("list", "peers", "--json")[1])}
    assert rows["scipy-dop853"]["installed"] == metadata.version("scipy")

    monkeypatch.setattr("phasebench.reference.installed.version_of", lambda package: None)
    assert {r["installed"] for r in strict(call("list", "peers", "--json")[1])} == {None}
    assert strict(call("list", "peers", "--installed", "--json")[1]) == []
    assert len(strict(call("list", "peers", "--not-installed", "--json")[1])) == len(PEERS)


@pytest.mark.lowest
def test_version_option():
    import importlib.metadata as metadata

    assert call("--version")[:2] == (0, f"phasebench {metadata.version('phasebench')}\n")


def test_lists_and_help_import_no_heavy_package():
    assert imported_packages(("list", "methods"), ("list", "problems"), ("list", "peers"), ("--help",)) == []


def test_control_imported_package_is_seen():
    assert imported_packages(("list", "methods"), heavy=("typer", REGISTRY)) == ["typer", REGISTRY]


def test_module_lists_in_less_than_two_seconds():
    """Processor time, as other programs may be running; all lists import the same modules."""
    resource = pytest.importorskip("resource")

    def spent() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before = spent()
    command = [sys.executable, "-m", "phasebench", "list", "methods", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert spent() - before < 2
    assert [row["method"] for row in strict(done.stdout)] == REGISTERED["methods"]


# -- integrate: the contract -------------------------------------------------------------------------------------------


@pytest.mark.lowest
def test_json_has_the_keys_of_the_contract():
    code, found = run_json("kepler", "stormer-verlet", *SHORT)
    assert code == 0
    assert list(found) == CONTRACT
    assert list(found["counts"]) == COUNTS
    assert set(found["invariants"]) == set(problem("kepler").invariants)
    for error in (found["energy_error"], *found["invariants"].values()):
        assert list(error) == ["max", "end"]
    assert (found["problem"], found["method"], found["status"], found["reason"]) == (
        "kepler",
        "stormer-verlet",
        "ok",
        "",
    )


def test_json_of_a_failed_run_has_the_same_keys():
    assert list(run_json("henon-heiles", "explicit-euler", "--h", "1", "--t-end", "100")[1]) == CONTRACT


@pytest.mark.parametrize(("name", "id"), [("henon-heiles:box", "rk4"), ("kepler", "implicit-midpoint")])
def test_json_numbers_equal_the_library_bit_for_bit(name, id):
    _, found = run_json(name, id, "--h", "0.03", "--t-end", "2")
    made = problem(name)
    s = integrate(made, id, h=0.03, t_end=2)
    assert found["q"] == s.q[-1].tolist()
    assert found["p"] == s.p[-1].tolist()
    assert (found["t"], found["h"], found["steps"]) == (s.t[-1], s.h, len(s.t) - 1)
    assert found["counts"] == {k: s.counts[k] for k in COUNTS}
    assert found["seconds"] > 0
    for expression, error in [(made.system.H, found["energy_error"])] + [
        (e, found["invariants"][n]) for n, e in made.invariants.items()
    ]:
        value = made.system.observe(expression, s.q, s.p)
        assert error == {"max": np.abs(value - value[0]).max(), "end": value[-1] - value[0]}


def test_energy_error_max_over_steps_and_signed_end():
    """Against Stormer-Verlet on H = p^2/2 - cos q coded here: the largest error occurs before the end."""
    q, p, h = 2.0, 0.0, 0.1
    H = [p * p / 2 - np.cos(q)]
    for _ in range(29):
        p -= h / 2 * np.sin(q)
        q += h * p
        p -= h / 2 * np.sin(q)
        H.append(p * p / 2 - np.cos(q))
    error = np.array(H) - H[0]
    assert abs(error[-1]) < 0.9 * np.abs(error).max()
    assert error[-1] < 0
    _, found = run_json("pendulum", "stormer-verlet", "--h", "0.1", "--steps", "29")
    assert found["energy_error"]["max"] == pytest.approx(np.abs(error).max(), rel=1e-9)
    assert found["energy_error"]["end"] == pytest.approx(error[-1], rel=1e-9)


def test_initial_state_is_used():
    _, found = run_json("henon-heiles", "rk4", *SHORT, "--q", "0.1,-1/3", "--p", "0,0.25")
    s = integrate(problem("henon-heiles"), "rk4", h=0.1, t_end=1, q0=[0.1, -1 / 3], p0=[0, 0.25])
    assert found["q"] == s.q[-1].tolist()
    other = integrate(problem("henon-heiles"), "rk4", h=0.1, t_end=1)
    assert found["q"] != other.q[-1].tolist()


def test_fractions_stay_exact():
    from fractions import Fraction

    _, found = run_json("pendulum", "scheme-i", *SHORT, "--param", "lam=1/3")
    s = integrate(problem("pendulum"), "scheme-i", h=0.1, t_end=1, parameters={"lam": Fraction(1, 3)})
    assert found["params"] == {"lam": "1/3"}
    assert found["q"] == s.q[-1].tolist()
    assert found["q"] != run_json("pendulum", "scheme-i", *SHORT, "--param", "lam=2/3")[1]["q"]


def test_number_of_steps_sets_the_step():
    _, found = run_json("pendulum", "rk4", "--steps", "7", "--t-end", "1")
    assert (found["steps"], found["h"], found["t"]) == (7, 1 / 7, 1.0)


def test_step_is_shortened_to_fit_the_span():
    _, found = run_json("pendulum", "rk4", "--h", "0.332", "--t-end", "1")
    assert (found["steps"], found["h"], found["t"]) == (3, 1 / 3, 1.0)


def test_step_that_would_be_widened_is_refused():
    result = call("integrate", "pendulum", "rk4", "--h", "0.3", "--t-end", "1")
    assert result.exit_code == 2
    assert all(x in result.stderr for x in (repr(1 / 3), "0.25"))


def test_problem_parameter_is_set():
    _, found = run_json("kepler", "rk4", *SHORT, "--set", "e=0.2")
    s = integrate(problem("kepler", e=0.2), "rk4", h=0.1, t_end=1)
    assert found["q"] == s.q[-1].tolist()
    assert found["q"] != run_json("kepler", "rk4", *SHORT)[1]["q"]


@pytest.mark.lowest
def test_adaptive_peer_takes_a_tolerance():
    code, found = run_json("kepler", "heyoka", "--t-end", "1", "--tol", "1e-15")
    assert code == 0
    assert list(found) == CONTRACT
    assert found["params"] == {"tol": 1e-15}
    # A Taylor method follows the tolerance by its order, so the error changes rather than the number of steps.
    _, rough = run_json("kepler", "heyoka", "--t-end", "1", "--tol", "1e-5")
    assert rough["energy_error"]["max"] > 1e3 * max(found["energy_error"]["max"], 1e-16)
    s = integrate(problem("kepler"), "rk4", h=1e-3, t_end=1)
    assert np.abs(np.array(found["q"]) - s.q[-1]).max() < 1e-9


@pytest.mark.lowest
def test_text_and_json_agree():
    code, text, _ = call("integrate", "kepler", "rk4", *SHORT)
    assert code == 0
    found = run_json("kepler", "rk4", *SHORT)[1]
    for number in (*found["q"], *found["p"]):
        assert repr(number) in text
    assert "angular-momentum" in text


# -- integrate: invalid input and failed runs --------------------------------------------------------------------------

#: Besides those of bad_input.txt.
INVALID = [
    (("pendulm", "rk4", *SHORT), "pendulum"),
    (("henon-heiles:bxo", "rk4", *SHORT), "box"),
    (("pendulum", "heyok", *SHORT), "heyoka"),
    (("pendulum", "rk4", "--h", "-0.1", "--t-end", "1"), "h is -0.1"),
    (("pendulum", "rk4", "--h", "0.1", "--t-end", "inf"), "it must be a finite number"),
    (("henon-heiles", "rk4", *SHORT, "--p", "1"), "p0 has 1 components"),
    (("pendulum", "scheme-i", *SHORT, "--param", "mu=1"), "no parameter 'mu'"),
    (("pendulum", "scheme-i", *SHORT, "--param", "lam=1e400"), "lam"),
    (("kepler", "rk4", *SHORT, "--set", "e=1"), "eccentricity e is 1"),
    (("kepler", "rk4", *SHORT, "--set", "f=1"), "no parameter 'f'"),
    (("kepler", "rk4", *SHORT, "--set", "e=0.1,0.2"), "0.1,0.2"),
    (("lotka-volterra", "scheme-iv", *SHORT), "canonical"),
    (("kepler", "heyoka", "--t-end", "1", "--param", "lam=1"), "no parameters"),
    (("kepler", "rk4", *SHORT, "--q", "0,0"), "singularity"),
]


@pytest.mark.parametrize(("arguments", "message"), INVALID, ids=lambda x: " ".join(x) if isinstance(x, tuple) else "")
def test_invalid_input_is_named(arguments, message):
    code, found = run_json(*arguments)
    assert code == 2
    assert found["status"] == "invalid"
    assert message in found["reason"]
    done = call("integrate", *arguments)
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.said == "invalid: " + " ".join(found["reason"].split())


@pytest.mark.parametrize("name", ["pend[/]", "rk4[/b]", "[red]"])
def test_name_in_brackets_is_printed_verbatim(name):
    done = call("integrate", name, "rk4", *SHORT)
    assert done.exit_code == 2
    assert name in done.said


def test_blow_up_is_reported_as_diverged():
    code, found = run_json("henon-heiles", "explicit-euler", "--h", "1", "--t-end", "100")
    assert code == 1
    assert found["status"] == "diverged"
    assert 0 < found["steps"] < 100
    assert f"step {found['steps']} of 100" in found["reason"]
    assert np.isfinite([*found["q"], *found["p"], found["energy_error"]["max"]]).all()
    assert found["energy_error"]["max"] > 1
    code, text, _ = call("integrate", "henon-heiles", "explicit-euler", "--h", "1", "--t-end", "100")
    assert code == 1
    assert "diverged" in text


@pytest.mark.parametrize("steps", ["2", "100"])
def test_overflowing_energy_is_not_reported_as_conserved(steps):
    """At q = 1e156 the energy overflows a double: an error of 0 would be false."""
    code, text, _ = call(
        "integrate", "harmonic-oscillator", "explicit-euler", "--h", "1e3", "--steps", steps, "--q", "1e150", "--json"
    )
    error = strict(text)["energy_error"]
    assert error["max"] is None or error["max"] > 0
    assert code in (0, 1)


def test_fall_into_the_centre_is_a_collision():
    code, found = run_json(
        "kepler", "stormer-verlet", "--q", "1,0", "--p", "0,0", "--h", "0.01", "--t-end", "3"
    )  # the collision is at t = pi / (2 sqrt 2) = 1.11
    assert code == 1
    assert found["status"] == "collision"
    assert "t = 1.1" in found["reason"]


def test_control_circular_orbit_is_ok():
    code, found = run_json("kepler", "stormer-verlet", "--q", "1,0", "--p", "0,1", "--h", "0.01", "--t-end", "3")
    assert (code, found["status"]) == (0, "ok")


def test_timeout_is_reported():
    code, found = run_json("pendulum", "rk4", "--h", "1e-6", "--t-end", "20", "--time-limit", "0.01")
    assert code == 1
    assert found["status"] == "timeout"
    assert 0 < found["steps"] < 20_000_000


# -- integrate: the user's own step, messages on a terminal ------------------------------------------------------------

STEP = "def step(system, q, p, h):\n    p = p - h * system.dH_dq(q, p)\n    return q + h * system.dH_dp(q, p), p\n"


def test_file_with_a_step_is_a_method(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(STEP)
    monkeypatch.chdir(tmp_path)
    code, found = run_json("henon-heiles:box", "./mine.py", *SHORT)
    assert code == 0
    assert list(found) == CONTRACT
    expected = run_json("henon-heiles:box", "symplectic-euler-p", *SHORT)[1]
    assert np.abs(np.array(found["q"]) - expected["q"]).max() < 1e-14
    assert (found["method"], found["params"]) == ("./mine.py", {})
    (tmp_path / "mine.py").write_text(STEP.replace("dH_dq", "dV"))
    code, found = run_json("henon-heiles:box", "./mine.py", *SHORT)
    assert (code, found["status"]) == (2, "invalid")
    assert "./mine.py, line 2" in found["reason"]


@pytest.mark.parametrize(("options", "terminal"), [((), True), (("--json",), True), ((), False)])
def test_terminal_announces_compilation(options, terminal, monkeypatch):
    screen = io.StringIO()
    monkeypatch.setattr(shared, "err", Console(file=screen, force_terminal=terminal))
    assert call("integrate", "pendulum", "rk4", *SHORT, *options)[0] == 0
    if terminal and not options:
        assert "compiling the functions of rk4 for d = 1" in screen.getvalue()
    else:
        assert screen.getvalue() == ""


# -- run and report ----------------------------------------------------------------------------------------------------

SWEEP = ("--scene", "lotka-volterra-t1", "--method", "rk4", "--quick")


@pytest.fixture(scope="module")
def swept(tmp_path_factory) -> str:
    """The rows of a small sweep, as JSON lines."""
    path = tmp_path_factory.mktemp("rows") / "rows.jsonl"
    assert call("run", *SWEEP, "--output", str(path))[0] == 0
    return path.read_text()


def test_run_writes_a_row_for_each_step_size(swept):
    rows = [strict(line) for line in swept.splitlines()]
    scene = next(s for s in SCENES if s.id == "lotka-volterra-t1")
    assert [r["h"] for r in rows] == list(scene.ladder(quick=True))
    assert {(r["scene"], r["id"], r["status"]) for r in rows} == {("lotka-volterra-t1", "rk4", "ok")}


def test_second_run_measures_nothing(swept, tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text(swept)
    done = call("run", *SWEEP, "--output", str(path))
    assert done.exit_code == 0
    assert "1 of 1 cells" in done.said
    assert "4 ok" in done.stdout
    assert path.read_text() == swept


def test_changed_method_is_measured_again(swept, tmp_path, monkeypatch):
    path = tmp_path / "rows.jsonl"
    path.write_text(swept)
    monkeypatch.setitem(registry.BY_ID, "rk4", replace(registry.BY_ID["explicit-euler"], id="rk4"))
    done = call("run", *SWEEP, "--output", str(path))
    assert (done.exit_code, "cells are in" in done.said) == (0, False)
    old, new = ([strict(line)["global_error"] for line in text.splitlines()] for text in (swept, path.read_text()))
    assert all(b > 2 * a for a, b in zip(old, new, strict=True))


@pytest.mark.parametrize("at", [1, 3])
@pytest.mark.parametrize("line", ["", '{"cell": ', "no row"])
def test_cell_with_an_unreadable_row_is_measured_again(swept, tmp_path, at, line):
    lines = swept.splitlines()
    lines[at] = line
    path = tmp_path / "rows.jsonl"
    path.write_text("\n".join(lines) + "\n")
    done = call("run", *SWEEP, "--output", str(path))
    assert (done.exit_code, "cells are in" in done.said) == (0, False)
    times = ("seconds", "spent")
    old, new = ([{k: v for k, v in strict(x).items() if k not in times} for x in text.splitlines()]
                for text in (swept, path.read_text()))  # fmt: skip
    assert old == new


def test_run_of_another_method_keeps_the_old_rows(swept, tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text(swept)
    assert call("run", "--scene", "lotka-volterra-t1", "--method", "avf", "--quick", "--output", str(path))[0] == 0
    text = path.read_text()
    assert text.startswith(swept)
    assert {strict(line)["id"] for line in text.splitlines()} == {"rk4", "avf"}


@pytest.mark.parametrize(
    ("option", "name", "nearest"), [("--scene", "kepler-t2", "kepler-t1"), ("--method", "rk5", "rk4")]
)
def test_run_suggests_the_nearest_name(option, name, nearest, tmp_path):
    done = call("run", option, name, "--output", str(tmp_path / "rows.jsonl"))
    assert done.exit_code == 2
    assert nearest in done.said


def test_report_of_rows(swept, tmp_path):
    (tmp_path / "rows.jsonl").write_text(swept)
    folder = tmp_path / "report"
    arguments = ("--reports", str(folder), "--rows", str(tmp_path / "rows.jsonl"), "--html", str(tmp_path / "site"))
    code, text, _ = call("report", *arguments)
    assert code == 0
    assert "index.html" in text
    assert "lotka-volterra" in (tmp_path / "site" / "orders.html").read_text()
    # A sweep with --quick is no full run.
    assert "full run" not in (folder / "README.md").read_text()


@pytest.mark.parametrize(
    ("scene", "method"), [("lotka-volterra-t120", "rk4"), ("lotka-volterra-t1", "avf")], ids=["drift", "skipped"]
)
def test_report_of_rows_without_an_order(scene, method, tmp_path):
    rows = str(tmp_path / "rows.jsonl")
    assert call("run", "--scene", scene, "--method", method, "--quick", "--output", rows)[0] == 0
    code, _, _ = call("report", "--reports", str(tmp_path / "report"), "--rows", rows)
    assert code == 0


def test_cache_shows_its_folder_and_is_cleared(tmp_path, monkeypatch):
    from phasebench.integrators.compile import cache

    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    cache.write("a.py", bytes(1000))
    _, text, _ = call("cache", "--json")
    state = strict(text)
    assert state["folder"] == str(tmp_path)
    assert (state["entries"], state["other_versions"]) == (1, 0)
    assert 1000 < state["bytes"] < 1200
    assert str(tmp_path)[:30] in call("cache")[1], "the table is cut at the terminal's width"
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
    assert len(todo) == len(set(todo))
    assert {name for _, _, names in todo for name in names} == {
        name for name in PROBLEMS if problem(name).system.d <= command.LARGEST
    }
    assert {f for f, _, _ in todo} == {m.family for m in METHODS}
    done, failures = command.made(("splitting", 1, ("pendulum",)))
    assert done > 1
    assert not failures
    assert any(path.name.startswith("splitting-") for path in cache.folder().iterdir())
    monkeypatch.setattr(driver, "warm", lambda *_, **__: 1 / 0)
    done, failures = command.made(("splitting", 1, ("pendulum",)))
    assert done == 0
    assert all("ZeroDivisionError" in line for line in failures)
    monkeypatch.setattr(command, "_in_processes", lambda todo, jobs: iter([(1, []), (0, ["a on b: no"])]))
    complaint = call("cache", "--build")
    assert complaint.exit_code == 1
    assert "a on b: no" in complaint.said


def test_json_has_null_for_what_is_not_finite(capsys):
    shared.print_json({"a": [float("nan"), np.float64("inf"), 1 / 3], "b": {"c": -float("inf")}})
    assert strict(capsys.readouterr().out) == {"a": [None, None, 1 / 3], "b": {"c": None}}


def test_long_state_is_shortened():
    short, long = [0.1] * 12, [float(k) for k in range(13)]
    assert shortened(short) == ", ".join(["0.1"] * 12)
    assert shortened(long) == "0.0, 1.0, 2.0, ..., 10.0, 11.0, 12.0 (13 numbers; all with --json)"


def test_progress_lines_without_a_terminal_become_rarer(monkeypatch, capsys):
    """A measurement may take minutes; the log shows that it continues."""
    now = [0.0]
    monkeypatch.setattr(shared.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(shared, "err", Console(file=sys.stderr, force_terminal=False))
    with shared.telling("validate") as tell:
        for second in range(600):
            now[0] = float(second)
            tell(f"[{second}]")
    told = [int(line.strip().strip("[]")) for line in capsys.readouterr().err.splitlines()]
    pauses = [b - a for a, b in zip([0, *told], told, strict=False)]
    assert pauses[0] <= 3
    assert max(pauses) <= 61
    assert pauses == sorted(pauses)
    assert len(told) < 20
    with shared.telling("validate") as tell:
        tell("at once")
    assert capsys.readouterr().err == ""
