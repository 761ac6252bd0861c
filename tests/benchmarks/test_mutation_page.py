"""The page of the mutation score: its sentences follow the table."""

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.catalogue import cells, mutation, mutation_page
from phasebench.benchmarks.page.page import ROWS


def scored(survived=0, same=True, folder="b"):
    row = {"mutants": 9, "tried": 5, "killed": 4, "equivalent": 1, "survived": 0, "as judged": True}
    other = {"tried": 5 + survived, "survived": survived, "as judged": same}
    return pd.DataFrame([row | {"file": "a/x.py"}, row | other | {"file": f"{folder}/y.py"}])


def said(verdict, **values):
    return verdict({"mutation": scored(**values)}.get)


def test_a_survivor_is_told():
    good, bad = said(mutation_page.noticed), said(mutation_page.noticed, survived=6)
    assert good.holds
    assert (
        good.text == "Of 10 mutants of 2 files the tests notice 8 (80.0%); 2 are argued to change nothing; 0 survive."
    )
    assert not bad.holds
    assert bad.text.endswith(
        "Of 16 mutants of 2 files the tests notice 8 (50.0%); 2 are argued to change nothing; 6 survive: in b/y.py."
    )
    assert bad.short == "The tests notice 8 of 16 mutants; 6 survive."


def test_a_file_with_one_survivor_is_named():
    assert said(mutation_page.noticed, survived=1).text.endswith("1 survive: in b/y.py.")


def test_folders_stand_in_their_order_with_the_files_first():
    shown = mutation_page.table({"mutation": scored()}.get).frame
    assert list(shown.columns) == ["folder", "files", *mutation_page.COUNTS]
    row = scored().iloc[0]
    many = pd.DataFrame([{**row, "file": f"{k:03d}/x.py"} for k in range(ROWS + 3)])
    assert list(mutation_page.table({"mutation": many}.get).frame["folder"]) == [f"{k:03d}" for k in range(ROWS)]


def test_no_folder_of_the_score_that_is_kept_is_left_out():
    kept = pd.DataFrame(mutation.frame())
    shown = mutation_page.table({"mutation": kept}.get).frame
    assert shown["files"].sum() == len(kept)
    assert {"integrators/families", "integrators/engine", "reference/peers"} < set(shown["folder"])


@pytest.mark.parametrize(("same", "text"), [(True, "2 of 2"), (False, "1 of 2")])
def test_a_file_that_has_changed_since_is_named(same, text):
    found = said(mutation_page.judged, same=same)
    assert found.holds
    assert found.text.startswith(f"{text} files are as they were when they were judged")
    assert ("changed since: b/y.py." in found.text) != same


def test_folders_are_summed_and_files_kept():
    table = mutation_page.table({"mutation": scored(survived=2, folder="a")}.get).frame
    assert table.to_dict("records") == [
        {"folder": "a", "files": 2, "mutants": 18, "tried": 12, "killed": 8, "equivalent": 2, "survived": 2}
    ]
    assert len(mutation_page.whole({"mutation": scored()}.get)) == 2


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
    before = mutation.digests(tmp_path / "score.csv", tmp_path)
    (tmp_path / "x.py").write_text("2")
    assert mutation.digests(tmp_path / "score.csv", tmp_path) != before


def test_the_command_and_the_page_agree_on_a_file(monkeypatch):
    monkeypatch.syspath_prepend(str(mutation.SCORE.parent))
    import score

    assert len(mutation.frame()) == len(score.read())
    assert score.AND == mutation.AND
    assert score.digest(mutation.SCORE) == mutation.digest(mutation.SCORE)


def test_without_the_suites_tests_there_is_no_score(monkeypatch, tmp_path):
    whole = [table for cell in cells.cells() for table in cell.tables]
    assert whole[-1] == cells.MUTANTS
    assert cells.tried() == {cells.MUTANTS: mutation.frame()}
    monkeypatch.setattr(mutation, "SCORE", tmp_path / "score.csv")
    assert [table for cell in cells.cells() for table in cell.tables] == whole[:-1]
    assert cells.cells(quick=True) == []
