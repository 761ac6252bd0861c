"""What a row depends on: the hash follows a coefficient, a formula and the code that counts, and nothing else."""

from __future__ import annotations

import shutil
from dataclasses import replace
from fractions import Fraction

import mpmath
import pytest

from phasebench.benchmarks.experiments.kepler import comparison, cost
from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.measure.multiprecision import changed, leaves
from phasebench.benchmarks.problems.scenes import BY_ID, SCENES
from phasebench.benchmarks.rows import sources
from phasebench.benchmarks.rows.cells import Problem, content, exact
from phasebench.integrators import registry
from phasebench.integrators.registry import method

SPLITTING = "phasebench.integrators.families.splitting"
SWEEP = "phasebench.benchmarks.experiments.trade.sweep"
REBOUND, KEPLER = "phasebench.reference.peers.rebound", "phasebench.benchmarks.problems.kepler"


def hashes(cells):
    return {c.id: c.content for c in cells}


def test_a_coefficient_changes_the_rows_of_its_method_alone(monkeypatch):
    before = hashes(sweep.cells())
    pefrl = method("pefrl")
    path, x = next(leaves(pefrl.data))
    with mpmath.workdps(40):
        bad = replace(pefrl, data=changed(pefrl.data, path, mpmath.mpf(x) * (1 + mpmath.mpf(10) ** -20)))
    monkeypatch.setitem(registry.BY_ID, "pefrl", bad)
    after = hashes(sweep.cells())
    assert {id for id in before if after[id] != before[id]} == {f"rows|scene={s.id}|method=pefrl" for s in SCENES}


def test_prose_changes_no_row():
    pefrl = method("pefrl")
    assert content(pefrl) == content(replace(pefrl, source="another", name="another", cite=()))
    assert content(pefrl) != content(replace(pefrl, order=5))
    assert content(pefrl) != content(replace(pefrl, family="runge_kutta"))


def test_numbers_are_told_apart_whatever_the_working_precision():
    x = mpmath.mpf(1) / 3
    with mpmath.workdps(60):
        assert exact(x) == exact(+x) or exact(x).startswith("mpf")
        same, other = exact(x), exact(mpmath.mpf(1) / 3)
    assert exact(x) == same != other
    assert len({exact(v) for v in (1, 1.0, Fraction(1, 3), "1", None, (1,), 0.1 + 0.2, 0.3)}) == 8


def test_a_problems_parameters_and_a_scenes_steps_count():
    assert content(Problem("kepler", (("e", 0.2),))) != content(Problem("kepler", (("e", 0.6),)))
    assert content(Problem("kepler")) != content(Problem("perturbed-kepler"))
    scene = BY_ID["kepler-t1"]
    cells = [sweep.cells(scenes=[s], only=lambda m: m.id == "rk4")[0] for s in (scene, replace(scene, steps=(0.1,)))]
    assert cells[0].id == cells[1].id
    assert cells[0].content != cells[1].content


MODULES = (SPLITTING, SWEEP, REBOUND, KEPLER)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """(The three folders, to be edited, the digests of `MODULES` before that)."""
    root = tmp_path_factory.mktemp("copy")
    for folder in ("integrators", "reference", "benchmarks"):
        shutil.copytree(sources.ROOT / folder, root / folder, ignore=shutil.ignore_patterns("__pycache__", "*.csv"))
    digests = {m: sources.digest([m], root) for m in MODULES}
    assert digests == {m: sources.digest([m]) for m in MODULES}
    return root, digests


@pytest.mark.parametrize(
    ("file", "old", "new", "moved"),
    [
        (
            "integrators/families/splitting.py",
            "    return len(samples.q), 0",
            "    return len(samples.p), 0",
            {SPLITTING},
        ),
        (
            "integrators/engine/vector.py",
            "import numpy",
            "import math\nimport numpy",
            {SPLITTING, SWEEP, REBOUND, KEPLER},
        ),
        ("benchmarks/measure/metrics.py", "import numpy", "import math\nimport numpy", {SWEEP}),
        ("benchmarks/experiments/trade/peer_rows.py", "MOST, ADAPTIVE = 5000", "MOST, ADAPTIVE = 4000", {SWEEP}),
        ("integrators/records/splittings.py", "import", "import  math, ", set()),
        ("reference/peers/particles.py", "import numpy", "import math\nimport numpy", {REBOUND}),
        ("reference/peers/heyoka.py", "import numpy", "import math\nimport numpy", set()),
        ("benchmarks/problems/base.py", "import sympy", "import math\nimport sympy", {KEPLER}),
        ("benchmarks/problems/pendulum.py", "import", "import  math, ", set()),
        ("integrators/families/runge_kutta.py", "def run(", "def  run(", set()),
        ("benchmarks/page/markdown.py", "import math", "import cmath", set()),
        ("integrators/engine/vector.py", '"""', '"""Another word. ', set()),
        ("integrators/families/splitting.py", "\n\n\ndef", "\n\n# a remark\n\ndef", set()),
    ],
)
def test_an_edit_changes_what_imports_it(copy, file, old, new, moved):
    root, before = copy
    path = root / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    for cached in (sources.closure, sources._file):
        cached.cache_clear()
    try:
        assert {m for m in MODULES if sources.digest([m], root) != before[m]} == moved
    finally:
        path.write_text(text)


def test_the_essence_keeps_what_runs():
    text = '"""Doc."""\n\nx = "# no comment"  # one\n\n\ndef f():\n    """Doc\n    more."""\n    return """kept"""\n'
    assert sources.essence(text) == 'x = "# no comment"\ndef f():\n    return """kept"""'


def test_every_cell_is_told_from_every_other():
    for made in (sweep.cells(), sweep.cells(quick=True), [*comparison.cells(), *cost.cells()]):
        assert len({c.id for c in made}) == len(made)
        assert len({c.content for c in made}) == len(made)
