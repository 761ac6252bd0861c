"""The command line: every listed scene can be run, time spans may be negative, errors are reported."""

from __future__ import annotations

import json

import pytest

from phasebench.benchmarks.cli.run import _cells
from support.commands import call


def test_every_listed_scene_has_cells():
    listed = {x["scene"] for x in json.loads(call("list", "scenes", "--json")[1])}
    assert {cell.key["scene"] for cell in _cells([], [], False)} == listed
    assert {cell.key["scene"] for cell in _cells(["pendulum-short"], ["pefrl"], False)} == {"pendulum-short"}


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


def test_unwritable_folder_is_named(tmp_path):
    path, wrong = tmp_path / "rows.jsonl", tmp_path / "file"
    wrong.write_text("x")
    assert call("run", "--scene", "pendulum-t2", "--method", "pefrl", "--quick", "--output", path)[0] == 0
    for folder in (wrong, wrong / "below"):
        code, _, said = call("report", "--reports", folder, "--rows", path)
        assert code == 2
        assert "cannot be written" in said


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
