"""The score of the suite under mutation: no survivor is left without a test or an argument."""

import tomllib
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOL = ROOT / "tests" / "mutation"


@pytest.fixture
def score(monkeypatch):
    monkeypatch.syspath_prepend(TOOL)
    import score as module

    return module


def test_no_survivor_of_a_file_as_it_was_judged_is_left_unargued(score):
    assert score.unargued(score.read(), ROOT) == []


def test_control_a_survivor_is_found_until_its_file_changes(score, tmp_path):
    (tmp_path / "module.py").write_text("LEAST = 3")
    hashed = score.digest(tmp_path / "module.py")
    kept, survivors = (
        tmp_path / "score.csv",
        ("module.py::: LEAST = 3 -> LEAST = 4", "module.py::f: return 1, 2 -> return"),
    )
    written = {"module.py": score.Score("module.py", hashed, 7, 4, 2, 0, survivors)}
    score.write(written, kept)
    assert score.read(kept) == written
    assert score.unargued(written, tmp_path) == list(survivors)
    counts = (7, 4, 2, 0, 2)
    assert score.table(written, tmp_path) == [("module.py", *counts, "as judged"), ("all", *counts, "")]
    (tmp_path / "module.py").write_text("LEAST = 4")
    assert score.table(written, tmp_path)[0][-1] == "changed"
    assert score.unargued(written, tmp_path) == []
    assert score.unargued({"gone.py": score.Score("gone.py", hashed, 1, 1, 0, 0, survivors)}, tmp_path) == []


def test_the_counts_add_up_and_every_file_is_there(score):
    scores = score.read()
    assert scores
    for path, of in scores.items():
        assert of.tried == of.killed + of.equivalent + len(of.survived), path
        assert 0 < of.tried <= of.mutants, path


def test_every_argument_is_one_for_a_mutant_of_a_file():
    argued = tomllib.loads((TOOL / "equivalent.toml").read_text()).get("equivalent", [])
    assert all(len(of["why"].split()) > 4 for of in argued)
    assert not [m for m, n in Counter(of["mutant"] for of in argued).items() if n > 1]
    gone = [of["mutant"] for of in argued if not (ROOT / of["mutant"].partition("::")[0]).is_file()]
    assert not gone
