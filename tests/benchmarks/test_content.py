"""The content hash of a row follows coefficients, formulae and executed code, and nothing else."""

from __future__ import annotations

import ast
import re
import shutil
from dataclasses import replace
from functools import cache

import mpmath
import pytest

from phasebench.benchmarks.ladder import sweep
from phasebench.benchmarks.problems.scenes import BY_ID, SCENES
from phasebench.benchmarks.store import cells
from phasebench.benchmarks.store.cells import ProblemKey, content
from phasebench.integrators import registry
from phasebench.integrators.compile import digest
from phasebench.integrators.registry import method
from phasebench.reference.peers import PEERS
from support.slips import leaves, replace_at

SPLITTING = "phasebench.integrators.families.splitting"
SWEEP = "phasebench.benchmarks.ladder.sweep"
REBOUND, KEPLER = "phasebench.reference.peers.rebound", "phasebench.benchmarks.problems.kepler"


@pytest.fixture(scope="module", autouse=True)
def unchanged_sources_are_parsed_once():
    """Cache the two functions that parse sources by the source's text, so that only edited files are parsed again."""
    with pytest.MonkeyPatch.context() as patch:
        for function in (digest.essence, digest.imports):
            patch.setattr(digest, function.__name__, cache(function))
        yield


def hashes(cells):
    return {c.id: c.content for c in cells}


def test_coefficient_changes_only_rows_of_its_method(monkeypatch):
    before = hashes(sweep.cells())
    pefrl = method("pefrl")
    path, x = next(leaves(pefrl.data))
    with mpmath.workdps(40):
        bad = replace(pefrl, data=replace_at(pefrl.data, path, mpmath.mpf(x) * (1 + mpmath.mpf(10) ** -20)))
    monkeypatch.setitem(registry.BY_ID, "pefrl", bad)
    after = hashes(sweep.cells())
    assert {id for id in before if after[id] != before[id]} == {f"rows|scene={s.id}|method=pefrl" for s in SCENES}


@pytest.mark.parametrize(
    ("old", "new", "same"), [("corrector = 17", "corrector = 11", False), ("# ", "# In words: ", True)]
)
def test_rows_of_a_peer_depend_on_what_its_list_says(monkeypatch, tmp_path, old, new, same):
    listed = (cells.PEERS / "rebound.toml").read_text(encoding="utf-8")
    (tmp_path / "rebound.toml").write_text(listed.replace(old, new), encoding="utf-8")
    before = content(PEERS["rebound-whfast"]).split("-")
    cells._listed.cache_clear()
    monkeypatch.setattr(cells, "PEERS", tmp_path)
    after = content(PEERS["rebound-whfast"]).split("-")
    cells._listed.cache_clear()
    assert (after[0], after[2]) == (before[0], before[2])
    assert (after[1] == before[1]) == same


def test_problem_parameters_and_scene_steps_count():
    assert content(ProblemKey("kepler", (("e", 0.2),))) != content(ProblemKey("kepler", (("e", 0.6),)))
    assert content(ProblemKey("kepler")) != content(ProblemKey("perturbed-kepler"))
    scene = BY_ID["kepler-t1"]
    cells = [sweep.cells(scenes=[s], only=lambda m: m.id == "rk4")[0] for s in (scene, replace(scene, steps=(0.1,)))]
    assert cells[0].id == cells[1].id
    assert cells[0].content != cells[1].content


MODULES = (SPLITTING, SWEEP, REBOUND, KEPLER)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """(root of a copy of the three source folders, to be edited; the digests of `MODULES` before editing)."""
    root = tmp_path_factory.mktemp("copy")
    for folder in ("integrators", "reference", "benchmarks"):
        shutil.copytree(digest.ROOT / folder, root / folder, ignore=shutil.ignore_patterns("__pycache__", "*.csv"))
    digests = {m: digest.digest([m], root) for m in MODULES}
    assert digests == {m: digest.digest([m]) for m in MODULES}
    return root, digests


@pytest.mark.parametrize(
    ("file", "old", "new", "moved"),
    [
        ("integrators/families/splitting.py", "counts.gradient += 1", "counts.gradient += 2", {SPLITTING}),
        ("integrators/values/vector.py", "import numpy", "import math\nimport numpy", {SPLITTING, SWEEP, KEPLER}),
        ("benchmarks/ladder/peer_rows.py", "MOST, ADAPTIVE = 5000", "MOST, ADAPTIVE = 4000", {SWEEP}),
        ("reference/peers/particles.py", "import numpy", "import math\nimport numpy", {REBOUND}),
        ("reference/peers/heyoka.py", "import numpy", "import math\nimport numpy", set()),
        ("benchmarks/problems/base.py", "from typing import", "import cmath\nfrom typing import", {KEPLER}),
        ("benchmarks/page/markdown.py", "import math", "import cmath", set()),
        ("integrators/values/vector.py", '"""', '"""Another word. ', set()),
    ],
)
def test_edit_changes_the_modules_that_import_it(copy, file, old, new, moved):
    root, before = copy
    path = root / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    for cached in (digest.closure, digest._file):
        cached.cache_clear()
    try:
        assert {m for m in MODULES if digest.digest([m], root) != before[m]} == moved
    finally:
        path.write_text(text)


def test_essence_is_what_a_source_computes():
    text = 'def f(x):\n    return [x, """kept"""]\n'
    same = (
        '"""Doc."""\n# one\n\ndef f(x):\n    """Doc\n    more."""\n    return [x, """kept"""]  # two\n',
        "from typing import Any\n\ndef f(x: Any) -> list:\n    return [x, 'kept']\n",
        "if TYPE_CHECKING:\n    import a\n\ndef f(\n    x: a.b,\n):\n    return [\n  x,\n  'kept',\n ]\n",
    )
    others = (text.replace("kept", "other"), text.replace("f(x)", "f(x=1)"), "import a\n" + text, "x: int = 1\n" + text)
    assert {digest.essence(s) for s in same} == {digest.essence(text)}
    assert digest.essence(text) not in {digest.essence(s) for s in others}
    assert digest.essence("class A(NamedTuple):\n    x: int\n") != digest.essence("class A(NamedTuple):\n    y: int\n")


FUNCTION = """
def f(a, b=2):
    x = a + b
    def g(y):
        z = x * y
        return z
    if a < 0:
        raise ValueError("a is negative")
    return g(a)
"""


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("x", "first", True),
        ('"a is negative"', 'f"{a} is below 0"', True),
        ("ValueError", "TypeError", False),
        ("b", "other", False),  # a parameter may be given by its name
        ("return z", "return x", False),
        ("x = a + b", "x = eval('x')", False),
    ],
)
def test_local_names_and_messages_change_no_digest(old, new, same):
    changed = re.sub(rf"(?<![\w'])({re.escape(old)})(?!\w)", new, FUNCTION)
    assert changed != FUNCTION
    assert (digest.essence(changed) == digest.essence(FUNCTION)) == same


def test_words_of_some_modules_change_no_digest():
    text = 'STATUS = "ok"\nREASON = "the energy is lost"\n'
    assert digest.essence(text, worded=True) == digest.essence(text.replace("lost", "kept"), worded=True)
    assert digest.essence(text) != digest.essence(text.replace("lost", "kept"))
    assert digest.essence(text, worded=True) != digest.essence(text.replace("ok", "bad"), worded=True)
    for name in digest.WORDED:
        source = digest.path_of(name).read_text()
        assert not re.search(r"\b(exec|eval|sympify|parse)\(", source), f"{name}: its texts may be code"


STUDY = """
from phasebench.a import one
from phasebench.b import two
STEPS = 3
def measure(x):
    return helper(x) * STEPS
def helper(x):
    return one(x)
def answer(rows):
    return f"{two(rows)} in words"
"""


def test_of_a_function_only_what_it_refers_to_counts():
    """So a page's words make none of its rows stale."""

    def part(text):
        tree = digest.part_of(ast.parse(text), "measure")
        return digest.essence(tree), digest.imports(tree, "phasebench.studies.x")

    kept, names = part(STUDY)
    assert part(STUDY.replace("in words", "said otherwise").replace("two(", "2 * two(")) == (kept, names)
    assert "phasebench.a.one" in names
    assert "phasebench.b.two" not in names
    for old, new in (("STEPS = 3", "STEPS = 4"), ("return one(x)", "return -one(x)"), ("* STEPS", "+ STEPS")):
        assert part(STUDY.replace(old, new))[0] != kept
    assert part(STUDY + "import math\nmath.pi = 3\n")[0] != kept, "a statement without a name may change anything"
    whole, one = (digest.closure(f"phasebench.benchmarks.studies.parts{name}") for name in ("", ":energy"))
    assert "phasebench.benchmarks.page.study" in whole
    assert "phasebench.benchmarks.page.study" not in one
    assert "phasebench.integrators.driver" in one
