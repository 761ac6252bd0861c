"""The command line: every listed scene can be run, time spans may be negative, errors are reported."""

from __future__ import annotations

import json
import os

import pytest

from phasebench.benchmarks.cli.run import _cells
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.integrators.errors import unknown_name
from support.commands import call


@pytest.mark.parametrize("name", [x["scene"] for x in json.loads(call("list", "scenes", "--json")[1])])
def test_every_listed_scene_has_cells(name):
    found = _cells([name], ["pefrl"], False)
    assert {cell.key["scene"] for cell in found} == {name}


def test_all_scenes_are_measured_by_default():
    assert {c.key["scene"] for c in _cells([], [], False)} == {x.id for x in (*SCENES, *QUESTIONS)}
    assert set() < {c.key["scene"] for c in _cells([], [], True)} <= {x.id for x in SCENES}


def test_scene_of_the_trade_off_has_rows_to_round_off(tmp_path):
    path = tmp_path / "rows.jsonl"
    options = ("--scene", "pendulum-short", "--method", "pefrl", "--method", "wisdom-holman", "--output", path)
    assert call("run", *options)[0] == 0
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    errors = [r["error"] for r in rows if r["status"] == "ok"]
    assert min(errors) < 1e-10 < 1e-3 < max(errors)
    assert [r["status"] for r in rows if r["method"] == "wisdom-holman"] == ["skipped"]
    code, _, said = call("run", *options)
    assert code == 0
    assert "2 of 2 cells" in said
    code, _, said = call("report", "--reports", tmp_path / "report", "--rows", path)
    assert code == 2
    assert "no page" in said


def test_run_without_arguments_describes_the_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, text, _ = call("run")
    assert code == 0
    assert f"on {len(SCENES) + len(QUESTIONS)} scenes" in text
    assert "hours" in text
    assert not list(tmp_path.iterdir())


def test_unwritable_folder_is_named(tmp_path):
    path, wrong = tmp_path / "rows.jsonl", tmp_path / "file"
    wrong.write_text("x")
    assert call("run", "--scene", "pendulum-t2", "--method", "pefrl", "--quick", "--output", path)[0] == 0
    for folder in (wrong, wrong / "below"):
        code, _, said = call("report", "--reports", folder, "--rows", path)
        assert code == 2
        assert "cannot be written" in said
    if os.getuid():  # root may write everywhere
        closed = tmp_path / "closed"
        closed.mkdir(mode=0o500)
        assert call("report", "--reports", closed, "--rows", path)[0] == 2


def test_name_is_suggested_once():
    assert str(unknown_name("method", "heyok", ["heyoka", "heyoka", "rk4"])).count("heyoka") == 1
    assert call("integrate", "pendulum", "heyok", "--h", "0.1", "--t-end", "1")[2].count("heyoka?") == 1


def test_swapped_arguments_are_recognized():
    code, _, said = call("integrate", "stormer-verlet", "pendulum", "--h", "0.1", "--t-end", "1")
    assert code == 2
    assert "integrate pendulum stormer-verlet" in said
    assert call("integrate", "pendulum", "stormer-verlet", "--h", "0.1", "--t-end", "1")[0] == 0


@pytest.mark.parametrize(
    ("span", "times"),
    [
        (("--h", "0.1", "--t-end", "-2"), (0.0, -2.0)),
        (("--h", "0.1", "--t-end", "3", "--t0", "5"), (5.0, 3.0)),
        (("--h", "-0.1", "--steps", "20"), (0.0, -2.0)),
        (("--h", "0.1", "--t-end", "-3", "--t0", "-5"), (-5.0, -3.0)),
    ],
)
def test_span_may_start_anywhere_and_be_negative(span, times):
    ahead = json.loads(call("integrate", "pendulum", "gauss-4", "--h", "0.1", "--t-end", "2", "--json")[1])
    code, text, said = call("integrate", "pendulum", "gauss-4", *span, "--error", "--json")
    assert code == 0, said
    found = json.loads(text)
    assert found["t"] == pytest.approx(times[1])
    assert found["q"] == pytest.approx(ahead["q"], rel=1e-12)  # the pendulum starts at rest
    sign = 1 if times[1] > times[0] else -1
    assert found["p"] == pytest.approx([sign * x for x in ahead["p"]], rel=1e-12)
    assert found["global_error"] < 1e-9
    assert call("integrate", "pendulum", "gauss-4", *span)[0] == 0
