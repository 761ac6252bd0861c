"""The page of the mutation score: its sentences follow the table."""

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.catalogue import cells, mutation, mutation_page
from phasebench.benchmarks.page.page import ROWS


def scored(survived=0, same=True, folder="b", left=()):
    row = {"judged": True, "mutants": 9, "tried": 5, "killed": 4, "equivalent": 1, "survived": 0, "as judged": True}
    other = {"tried": 5 + survived, "survived": survived, "as judged": same}
    none = {name: 0 * value for name, value in row.items()}
    rows = [row | {"file": "a/x.py"}, row | other | {"file": f"{folder}/y.py"}]
    return pd.DataFrame(rows + [none | {"file": file} for file in left])


def said(verdict, **values):
    return verdict({"mutation": scored(**values)}.get)


def test_a_survivor_is_told():
    good, bad = said(mutation_page.noticed), said(mutation_page.noticed, survived=6)
    assert good.holds
    assert good.text == (
        "Mutants were tried in 2 of 2 files, 10 of their 18: the tests notice 8 (80.0%); "
        "2 are argued to change nothing; 0 survive."
    )
    assert not bad.holds
    assert bad.text == (
        "Mutants were tried in 2 of 2 files, 16 of their 18: the tests notice 8 (50.0%); "
        "2 are argued to change nothing; 6 survive: in b/y.py."
    )
    assert bad.short == "The tests notice 8 of 16 mutants of 2 of 2 files; 6 survive."


def test_a_file_with_one_survivor_is_named():
    assert said(mutation_page.noticed, survived=1).text.endswith("1 survive: in b/y.py.")


def test_a_file_that_is_not_judged_is_told_in_every_sentence():
    left = ["a/z.py", "c/v/k/u.py", *(f"d/{k}.py" for k in range(6))]
    said_of = {name: said(getattr(mutation_page, name), left=left) for name in ("noticed", "judged", "unjudged")}
    assert said_of["noticed"].text.startswith("Mutants were tried in 2 of 10 files, 10 of their 18: ")
    assert said_of["noticed"].short.startswith("The tests notice 8 of 10 mutants of 2 of 10 files")
    assert said_of["judged"].text == "2 of these 2 files are as they were when they were judged."
    assert said_of["unjudged"].text == (
        "8 of 10 files are not judged, and nothing is known of them: `z.py` in a; `u.py` in c/v; 6 in d."
    )
    assert said_of["unjudged"].short == "8 of 10 files are not judged."
    assert not said_of["unjudged"].holds
    fewer = said(mutation_page.unjudged, left=left[:-1])
    assert fewer.text.endswith("`u.py` in c/v; `0.py`, `1.py`, `2.py`, `3.py` and `4.py` in d.")


def test_the_page_is_a_finding_until_every_file_is_judged():
    everything = said(mutation_page.unjudged)
    assert everything.holds
    assert everything.text == everything.short == "Not one of the 2 files is left out."
    assert not said(mutation_page.unjudged, left=["a/z.py"]).holds


def test_a_file_of_which_one_mutant_was_tried_is_judged():
    one = {"mutation": scored().assign(tried=1)}.get
    assert mutation_page.noticed(one).text.startswith("Mutants were tried in 2 of 2 files, 2 of their 18")
    assert mutation_page.judged(one).text.startswith("2 of these 2 files")
    assert mutation_page.unjudged(one).holds
    assert mutation_page.table(one).frame["not judged"].sum() == 0


def test_where_no_file_is_judged_nothing_passes():
    none = {"mutation": scored(left=["a/z.py", "c/v.py", "c/w.py"]).tail(3)}.get
    found = mutation_page.PAGE.judged(none)
    assert [(v.text.split(",")[0], v.holds) for v in found] == [
        ("Mutants were tried in 0 of 3 files.", False),
        ("3 of 3 files are not judged", False),
    ]
    assert mutation_page.judged(none) is None


def test_folders_stand_in_their_order_with_the_files_first():
    shown = mutation_page.table({"mutation": scored()}.get).frame
    assert list(shown.columns) == ["folder", "files", "not judged", *mutation_page.COUNTS]
    row = scored().iloc[0]
    many = pd.DataFrame([{**row, "file": f"{k:03d}/x.py"} for k in range(ROWS + 3)])
    assert list(mutation_page.table({"mutation": many}.get).frame["folder"]) == [f"{k:03d}" for k in range(ROWS)]


def test_no_folder_that_is_kept_is_left_out():
    kept = pd.DataFrame(mutation.frame())
    shown = mutation_page.table({"mutation": kept}.get).frame
    assert shown["files"].sum() == len(kept)
    assert shown["not judged"].sum() == (~kept["judged"]).sum()
    assert {"integrators/families", "integrators/engine", "reference/peers", "benchmarks/cli"} < set(shown["folder"])
    assert len(shown) < ROWS


@pytest.mark.parametrize(("same", "text"), [(True, "2 of these 2"), (False, "1 of these 2")])
def test_a_file_that_has_changed_since_is_named(same, text):
    found = said(mutation_page.judged, same=same)
    assert found.holds
    assert found.text.startswith(f"{text} files are as they were when they were judged")
    assert ("changed since: b/y.py." in found.text) != same


def test_folders_are_summed_and_files_kept():
    data = {"mutation": scored(survived=2, folder="a", left=["a/z.py", "e/f/g/h.py", "e/f/k.py"])}.get
    counts = {"mutants": 18, "tried": 12, "killed": 8, "equivalent": 2, "survived": 2}
    assert mutation_page.table(data).frame.to_dict("records") == [
        {"folder": "a", "files": 3, "not judged": 1} | counts,
        {"folder": "e/f", "files": 2, "not judged": 2} | dict.fromkeys(counts, 0),
    ]
    assert len(mutation_page.whole(data)) == 5


def test_the_score_is_read_and_compared_with_the_files(tmp_path):
    (tmp_path / "x.py").write_text("1")
    hashes = {"x.py": mutation.digest(tmp_path / "x.py"), "y.py": "0"}
    lines = ["path,hash,mutants,tried,killed,equivalent,survived"]
    lines += [
        f"{name},{of},9,4,2,1,{survived}"
        for (name, of), survived in zip(hashes.items(), ("", "a -> b && c -> d"), strict=True)
    ]
    (tmp_path / "score.csv").write_text("\n".join(lines))
    first, other = mutation.frame(tmp_path / "score.csv", tmp_path)
    assert (first["file"], first["tried"], first["survived"], first["as judged"]) == ("x.py", 4, 0, True)
    assert (other["survived"], other["as judged"]) == (2, False)
    assert first["judged"]
    assert other["judged"]
    before = mutation.digests(tmp_path / "score.csv", tmp_path)
    (tmp_path / "x.py").write_text("2")
    assert mutation.digests(tmp_path / "score.csv", tmp_path) != before


@pytest.fixture
def room(tmp_path):
    """(A score of one file, its root with that file and others, of which one more could be judged)."""
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
    score.write_text("path,hash,mutants,tried,killed,equivalent,survived\nintegrators/judged.py,0,9,4,4,0,\n")
    return score, tmp_path


def test_a_file_that_is_not_in_the_score_has_a_row_and_a_place_in_the_digest(room):
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
def test_a_file_with_a_function_a_comparison_or_a_number_can_be_changed(code):
    assert mutation.changeable(code)
    assert mutation.changeable(f'"""A docstring of 2 words."""\n\n{code}')


@pytest.mark.parametrize(
    "code", ["", '"""Of 3 words."""', "from a import b\n\n__all__ = ['b']", "@record(frozen=True)\nclass A: ..."]
)
def test_one_without_cannot(code):
    assert not mutation.changeable(code)


def test_no_file_of_which_nothing_is_said_has_a_mutant(monkeypatch):
    pytest.importorskip("cosmic_ray", reason="of the extra 'mutation'")
    monkeypatch.syspath_prepend(str(mutation.SCORE.parent))
    from mutants import mutants

    root, rows = mutation.sources.ROOT, {str(row["file"]) for row in mutation.frame()}
    files = {p.relative_to(root).as_posix() for folder in mutation.FOLDERS for p in (root / folder).rglob("*.py")}
    silent = {path for path in files - rows if mutation.TESTS not in path}
    assert len(silent) > 30
    assert [path for path in sorted(silent) if mutants(root, path)] == []


def test_the_command_and_the_page_agree_on_a_file(monkeypatch):
    monkeypatch.syspath_prepend(str(mutation.SCORE.parent))
    import score

    assert {row["file"] for row in mutation.frame() if row["judged"]} == set(score.read())
    assert score.AND == mutation.AND
    assert {len(of.hash) for of in score.read().values()} == {len(mutation.digest(mutation.SCORE))}
    assert score.digest(mutation.SCORE) == mutation.digest(mutation.SCORE)


def test_without_the_suites_tests_there_is_no_score(monkeypatch, tmp_path):
    whole = [table for cell in cells.cells() for table in cell.tables]
    assert whole[-1] == cells.MUTANTS
    assert cells.tried() == {cells.MUTANTS: mutation.frame()}
    monkeypatch.setattr(mutation, "SCORE", tmp_path / "score.csv")
    assert [table for cell in cells.cells() for table in cell.tables] == whole[:-1]
    assert cells.cells(quick=True) == []
