"""The page of the mutation score: its verdicts follow the table."""

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.catalogue import cells, mutation, mutation_page
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, PASS, Count


def score_table(survived=0, same=True, folder="b", left=()):
    """A fabricated mutation score of two files; ``survived`` mutants of the second survive.

    Mutants of the files in ``left`` were not tried.
    """
    row = {"judged": True, "mutants": 99, "tried": 40, "killed": 40, "survived": 0, "as judged": True}
    other = {"tried": 40 + survived, "survived": survived, "as judged": same}
    none = {name: 0 * value for name, value in row.items()}
    rows = [row | {"file": "a/x.py"}, row | other | {"file": f"{folder}/y.py"}]
    return pd.DataFrame(rows + [none | {"file": file} for file in left])


def judge(verdict, **values):
    """The page's verdict on a fabricated mutation score; ``values`` are arguments of `score_table`."""
    return verdict({"mutation": score_table(**values)}.get)


def test_many_surviving_mutants_fail():
    good, bad = judge(mutation_page.detection), judge(mutation_page.detection, survived=6)
    assert (good.outcome, good.measured, good.where) == (PASS, Count(80, 80), "")
    assert (bad.outcome, bad.measured, bad.where) == (FAIL, Count(80, 86), "b/y.py: 6 survive")
    assert judge(mutation_page.detection, survived=4).outcome == PASS


def test_file_without_mutants_is_a_finding():
    found = judge(mutation_page.coverage, left=["c/v/k/u.py", *(f"d/{k}.py" for k in range(6))])
    assert (found.outcome, found.measured) == (FINDING, Count(2, 9))
    assert found.where.startswith("d: 6 ")
    assert judge(mutation_page.coverage).outcome == PASS
    assert judge(mutation_page.coverage, left=["a/z.py"]).outcome == FINDING


def test_file_with_one_tried_mutant_is_covered():
    one = {"mutation": score_table().assign(tried=1)}.get
    assert mutation_page.coverage(one).outcome == PASS
    assert mutation_page.table(one).frame["not tried"].sum() == 0


def test_nothing_passes_without_tried_mutants():
    none = {"mutation": score_table(left=["a/z.py", "c/v.py", "c/w.py"]).tail(3)}.get
    assert [v.outcome for v in mutation_page.PAGE.judge(none)] == [FINDING, MISSING]


def test_folders_are_shown_in_order():
    shown = mutation_page.table({"mutation": score_table()}.get).frame
    assert list(shown.columns) == ["folder", "files", "not tried", *mutation_page.COUNTS]
    row = score_table().iloc[0]
    many = pd.DataFrame([{**row, "file": f"{k:03d}/x.py"} for k in range(ROWS + 3)])
    assert list(mutation_page.table({"mutation": many}.get).frame["folder"]) == [f"{k:03d}" for k in range(ROWS)]


def test_every_folder_of_the_score_is_shown():
    kept = pd.DataFrame(mutation.frame())
    shown = mutation_page.table({"mutation": kept}.get).frame
    assert shown["files"].sum() == len(kept)
    assert shown["not tried"].sum() == (~kept["judged"]).sum()
    assert {"integrators/families", "integrators/engine", "reference/peers", "benchmarks/cli"} < set(shown["folder"])
    assert len(shown) < ROWS


@pytest.mark.parametrize(("same", "count"), [(True, "none"), (False, "1")])
def test_caption_counts_files_changed_since(same, count):
    caption = mutation_page.table({"mutation": score_table(same=same)}.get).caption
    assert f" {count} changed since" in caption


def test_folders_are_summed_and_files_kept():
    data = {"mutation": score_table(survived=2, folder="a", left=["a/z.py", "e/f/g/h.py", "e/f/k.py"])}.get
    counts = {"mutants": 198, "tried": 82, "killed": 80, "survived": 2}
    assert mutation_page.table(data).frame.to_dict("records") == [
        {"folder": "a", "files": 3, "not tried": 1} | counts,
        {"folder": "e/f", "files": 2, "not tried": 2} | dict.fromkeys(counts, 0),
    ]
    assert len(mutation_page.full_table(data)) == 5


def test_score_is_read_and_compared_with_the_files(tmp_path):
    (tmp_path / "x.py").write_text("1")
    hashes = {"x.py": mutation.digest(tmp_path / "x.py"), "y.py": "0"}
    lines = ["path,hash,mutants,tried,killed,survived"]
    lines += [
        f"{name},{of},9,4,2,{survived}"
        for (name, of), survived in zip(hashes.items(), ("", "a -> b && c -> d"), strict=True)
    ]
    (tmp_path / "score.csv").write_text("\n".join(lines))
    first, other = mutation.frame(tmp_path / "score.csv", tmp_path)
    assert (first["file"], first["tried"], first["survived"], first["as judged"]) == ("x.py", 4, 2, True)
    assert (other["survived"], other["as judged"]) == (2, False)
    assert first["judged"]
    assert other["judged"]
    before = mutation.digests(tmp_path / "score.csv", tmp_path)
    (tmp_path / "x.py").write_text("2")
    assert mutation.digests(tmp_path / "score.csv", tmp_path) != before


@pytest.fixture
def room(tmp_path):
    """(score file with one entry, root folder that has one more file with code to mutate)."""
    files = {
        "integrators/judged.py": "1",
        "integrators/deep/below/left.py": "def f(): ...",
        "benchmarks/bench_x.py": "1",
        "benchmarks/__init__.py": '"""Nothing."""\n\nimport os',
        "tests/test_x.py": "1",
        "reference/kept.json": "1",
    }
    for path, code in files.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(code)
    score = tmp_path / "score.csv"
    score.write_text("path,hash,mutants,tried,killed,survived\nintegrators/judged.py,0,9,4,4,\n")
    return score, tmp_path


def test_unscored_file_has_a_row_and_enters_the_digest(room):
    score, root = room
    left, known = mutation.frame(score, root)
    assert left["file"] == "integrators/deep/below/left.py"
    assert list(left) == list(known)
    assert (left["judged"], left["as judged"], known["judged"]) == (False, False, True)
    assert {left[name] for name in mutation_page.COUNTS} == {0}
    before = mutation.digests(score, root)
    assert mutation.digests(score, root) == before
    (root / "benchmarks/__init__.py").write_text("LEAST = 3")
    grown = mutation.digests(score, root)
    assert next(row["file"] for row in mutation.frame(score, root)) == "benchmarks/__init__.py"
    (root / "integrators/deep/below/left.py").unlink()
    gone = mutation.digests(score, root)
    (root / "reference/new.py").write_text("x == y")
    assert len({tuple(of) for of in (before, grown, gone, mutation.digests(score, root))}) == 4


@pytest.mark.parametrize("code", ["LEAST = 3", "x = 0.5", "x == y", "def f(): ...", "class A:\n def f(self): ..."])
def test_file_with_code_to_mutate(code):
    assert mutation.changeable(code)
    assert mutation.changeable(f'"""A docstring of 2 words."""\n\n{code}')


@pytest.mark.parametrize(
    "code", ["", '"""Of 3 words."""', "from a import b\n\n__all__ = ['b']", "@record(frozen=True)\nclass A: ..."]
)
def test_file_without_code_to_mutate(code):
    assert not mutation.changeable(code)


def test_files_without_a_row_have_no_mutants(monkeypatch):
    pytest.importorskip("cosmic_ray", reason="of the extra 'mutation'")
    monkeypatch.syspath_prepend(str(mutation.SCORE.parent))
    from mutants import mutants

    root, rows = mutation.sources.ROOT, {str(row["file"]) for row in mutation.frame()}
    files = {p.relative_to(root).as_posix() for folder in mutation.FOLDERS for p in (root / folder).rglob("*.py")}
    silent = {path for path in files - rows if mutation.TESTS not in path}
    assert len(silent) > 30
    assert [path for path in sorted(silent) if mutants(root, path)] == []


def test_command_and_page_read_the_same_score(monkeypatch):
    monkeypatch.syspath_prepend(str(mutation.SCORE.parent))
    import score

    assert {row["file"] for row in mutation.frame() if row["judged"]} == set(score.read())
    assert score.AND == mutation.AND
    assert {len(of.hash) for of in score.read().values()} == {len(mutation.digest(mutation.SCORE))}
    assert score.digest(mutation.SCORE) == mutation.digest(mutation.SCORE)


def test_no_score_without_the_test_suite(monkeypatch, tmp_path):
    whole = [table for cell in cells.cells() for table in cell.tables]
    assert whole[-1] == cells.MUTANTS
    assert cells.mutation_rows() == {cells.MUTANTS: mutation.frame()}
    monkeypatch.setattr(mutation, "SCORE", tmp_path / "score.csv")
    assert [table for cell in cells.cells() for table in cell.tables] == whole[:-1]
    assert cells.cells(quick=True) == []
