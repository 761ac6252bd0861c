"""The mutation tool: each mutant changes one place, its effect and not only its text, and is judged correctly."""

import importlib.util
import json
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("cosmic_ray", reason="of the extra 'mutation'")
TOOL = Path(__file__).parent

CODE = '''"""A module."""

LEAST = 3


@decorated(order=1)
class Kind:
    scale: float = 0.5


def few(x: list | None, y=0):
    """Whether there are few."""
    if x is None or y:
        return True
    return min(len(x), 9) < LEAST - 1


def named(x):
    return listed(x, 5)


def draw(x):
    return x + 1
'''


@pytest.fixture(autouse=True)
def tool_on_the_path(monkeypatch):
    """The modules of the tool can be imported."""
    monkeypatch.syspath_prepend(TOOL)


@pytest.fixture
def mutants(tmp_path):
    """The mutants of CODE."""
    (tmp_path / "module.py").write_text(CODE)
    import mutants as module

    return module.mutants(tmp_path, "module.py")


def test_each_change_is_made_once_and_no_neutral_one(mutants):
    found = mutants
    changed = {"".join(m.after.split()) for m in found}
    expected = {
        "LEAST = 4",
        "scale: float = 5.0",
        "def few(x: list | None, y=1):",
        "if x is not None or y:",
        "if x is None and y:",
        "return False",
        "return max(len(x), 9) < LEAST - 1",
        "return min(len(x), 9) <= LEAST - 1",
        "return min(len(x), 9) >= LEAST - 1",
        "return min(len(x), 9) < LEAST + 1",
    }
    assert {"".join(line.split()) for line in expected} <= changed
    assert not any(part in line for line in changed for part in ("list&", "x-1", "order=", "x,6"))
    codes = [m.code for m in found]
    assert len({CODE, *codes}) == 1 + len(codes)
    assert {m.where for m in found} == {"", "few", "Kind", "named"}
    assert len({m.id for m in found}) == len(found)
    assert all(CODE.splitlines()[m.line - 1].strip() == m.before for m in found)


def test_help_lists_the_options():
    said = subprocess.run([sys.executable, TOOL, "--help"], capture_output=True, text=True, check=True).stdout
    assert all(
        option in said
        for option in ("--reach", "--by", "--sample", "--again", "--within", "--score", "--jobs", "--plain", "--most")
    )


def test_unrecorded_tests_are_rejected():
    done = subprocess.run([sys.executable, TOOL, "--by", "tests/none.py"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "not recorded, or they fail: tests/none.py" in done.stderr


OLD = """
def outer(x):
    def inner(y):
        return y + x
    return inner(1)

class Kind:
    def least(self):
        return 3

def plus(y=1):
    return y

TEN = 10
"""


@pytest.fixture
def module():
    """(names of a module made from OLD, a function that replaces the code of the functions that an edit changes)."""
    import swap

    names: dict = {}
    exec(compile(OLD, "somewhere.py", "exec"), names)

    def swapped(before: str, after: str) -> bool:
        old, new = (compile(code, "somewhere.py", "exec") for code in (OLD, OLD.replace(before, after)))
        found, made = swap.swaps(old, new), swap.functions("somewhere.py")
        for place, code in found or ():
            for function in made[place]:
                function.__code__ = code
        return found is not None

    return names, swapped


@pytest.mark.parametrize(
    ("before", "after", "call", "gives"),
    [
        ("y + x", "y - x", "outer(5)", -4),
        ("return 3", "return 4", "Kind().least()", 4),
        ("return y", "return 7", "plus()", 7),
    ],
)
def test_a_changed_function_replaces_every_reference(module, before, after, call, gives):
    names, swapped = module
    kept = dict(names)  # stands for another module that has imported the names
    assert eval(call, kept) != gives
    assert swapped(before, after)
    assert eval(call, kept) == gives


@pytest.mark.parametrize(
    ("before", "after"), [("TEN = 10", "TEN = 11"), ("y=1", "y=2"), ("class Kind:", "class Kind(int):")]
)
def test_code_that_runs_at_import_is_not_swapped(module, before, after):
    _, swapped = module
    assert not swapped(before, after)


def test_a_child_that_dies_or_hangs_is_reported():
    """`forked` returns the child's result, "died" when it exits and "hung" when it exceeds the time limit."""
    import worker

    assert worker.forked(lambda: "a test") == "a test"
    assert worker.forked(lambda: None) is None
    assert worker.forked(lambda: sys.exit(3)) == "died"
    assert worker.forked(lambda: time.sleep(60), patience=0.1) == "hung"
    assert worker.forked(lambda: max(iter(int, 1)), patience=0.5) == "hung"


@pytest.mark.parametrize(("failed", "by"), [(1, "collection"), (0, None)])
def test_an_import_error_in_collection_kills_the_mutant(monkeypatch, failed, by):
    import worker

    session = SimpleNamespace(items=[], testsfailed=failed)
    monkeypatch.setattr(worker, "collect", lambda files, loop: worker.Collected(loop).pytest_runtestloop(session))
    assert worker.alone(worker.Job("a.py", "", ("tests/a.py::test_one",), (), frozenset())) == by


def test_lines_that_run_once_are_left_out():
    """`often` leaves out lines that run at import, as defaults or class fields, or in a cached function."""
    from reach import often

    code = CODE + "\n\n@lru_cache(maxsize=2)\ndef once(x):\n    return x\n"
    lines = code.splitlines()
    assert {lines[n - 1].strip() for n in often(code)} == {
        '"""Whether there are few."""',
        "if x is None or y:",
        "return True",
        "return min(len(x), 9) < LEAST - 1",
        "return listed(x, 5)",
        "return x + 1",
    }


def test_kernels_count_as_python_without_compilation(monkeypatch):
    import worker

    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    kernel, driver = "integrators/families/splitting.py", "integrators/driver.py"
    assert worker.is_compiled(kernel)
    assert not worker.is_compiled(driver)
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert not worker.is_compiled(kernel)


def test_a_mutant_gets_cached_sources_but_no_machine_code(tmp_path):
    """`lend` copies (does not link) cached sources, but no machine code, into the mutant's cache."""
    import worker

    kept, place = tmp_path / "kept", tmp_path / "a" / "place"
    kept.mkdir()
    for name in ("f-1.py", "k-2.json", "splitting-3.machine"):
        (kept / name).write_text(name)
    worker.lend(kept, place)
    assert {p.name: p.read_text() for p in place.iterdir()} == {"f-1.py": "f-1.py", "k-2.json": "k-2.json"}
    (place / "f-1.py").write_text("changed")
    assert (kept / "f-1.py").read_text() == "f-1.py"
    worker.lend(tmp_path / "nowhere", tmp_path / "empty")
    assert list((tmp_path / "empty").iterdir()) == []


@pytest.fixture
def command():
    """The module tests/mutation/__main__.py."""
    found = importlib.util.spec_from_file_location("command", TOOL / "__main__.py")
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        (["room"], ["room/__init__.py", "room/kinds/__init__.py", "room/plain.py"]),
        (["room/__init__.py"], ["room/__init__.py"]),
        (["room/bare/__init__.py"], []),
        (["room/plain.py", "room/kinds"], ["room/plain.py", "room/kinds/__init__.py"]),
    ],
)
def test_a_package_is_mutated_where_it_holds_a_function(command, monkeypatch, tmp_path, asked, found):
    texts = {
        "__init__.py": "def few(x):\n    return x < 3\n",
        "bare/__init__.py": '"""A room."""\n\nfrom room.plain import LEAST\n',
        "kinds/__init__.py": "class Kind:\n    def least(self):\n        return 3\n",
        "plain.py": "LEAST = 3\n",
        "bench_plain.py": "def bench_plain():\n    return 3\n",
        "notes.txt": "3\n",
    }
    for name, text in texts.items():
        (tmp_path / "room" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "room" / name).write_text(text)
    monkeypatch.setattr(command, "ROOT", tmp_path)
    assert command.files(asked) == found


@pytest.fixture
def trial(command, monkeypatch, tmp_path):
    """Function (command-line options) -> `Trial` of a file that no recorded test reaches."""
    from reach import Reach

    of = {
        "tests/a.py::one[x]": {"seconds": 0.1, "failed": False},
        "tests/a.py::one[y]": {"seconds": 0.1, "failed": True},
        "tests/a.py::two": {"seconds": 0.1, "failed": False},
        "tests/b.py::one": {"seconds": 0.1, "failed": False},
        "tests/b.py::slow": {"seconds": 60.0, "failed": False},
    }
    (tmp_path / "reach.json").write_text(json.dumps({"tests": of, "files": {}}))

    def made(*options):
        monkeypatch.setattr(sys, "argv", ["mutation", *options])
        reach = Reach(tmp_path / "reach.sqlite", command.ROOT)
        return command.Trial("integrators/errors.py", reach, command.arguments())

    return made


@pytest.mark.parametrize(
    ("names", "asked", "files"),
    [
        (["tests/a.py"], {"tests/a.py::one[x]", "tests/a.py::two"}, ("tests/a.py",)),
        (["tests/a.py::one"], {"tests/a.py::one[x]"}, ("tests/a.py",)),
        (["tests/b.py", "tests/a.py::two"], {"tests/b.py::one", "tests/a.py::two"}, ("tests/a.py", "tests/b.py")),
    ],
)
def test_named_tests_judge_mutants_that_no_test_reaches(trial, names, asked, files):
    """With --by every mutant is judged by the named tests, except those that fail unmodified or take too long."""
    one = trial("--by", *names)
    assert all(set(one.tests(mutant)) == asked for mutant in one.all)
    assert one.files == files


def test_control_without_names_no_test_is_run(trial):
    one = trial()
    assert one.all
    assert one.files == ()
    assert not any(one.tests(mutant) for mutant in one.all)


def test_failing_tests_are_found_before_judging(trial):
    """Such a test would fail for every mutant and so seem to kill it."""
    one, jobs = trial("--by", "tests/b.py"), []
    assert one.failing(lambda job: jobs.append(job) or "tests/b.py::new") == "tests/b.py::new"
    (job,) = jobs
    assert job.code == (TOOL.parents[1] / one.path).read_text()
    known = frozenset({"tests/b.py::one", "tests/b.py::slow"})
    assert (job.tests, job.files, job.known) == (("tests/b.py::one",), ("tests/b.py",), known)


def test_importers_of_a_changed_module_are_unloaded(monkeypatch, tmp_path):
    import worker

    texts = {"base": "LEAST = 3", "user": "from .base import LEAST", "its_user": "import phasebench.user", "other": ""}
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
        module = type(sys)(f"phasebench.{name}")
        module.__file__, module.__package__ = str(tmp_path / f"{name}.py"), "phasebench"
        monkeypatch.setitem(sys.modules, module.__name__, module)
    worker.forget(tmp_path / "base.py")
    assert [name for name in texts if f"phasebench.{name}" in sys.modules] == ["other"]


def test_lazily_importing_packages_are_unloaded_too():
    """A lazily importing package holds objects of the changed module without an import statement in its text."""
    import worker

    from phasebench.integrators import errors
    from phasebench.reference import peers

    assert worker.lent(peers) == {"phasebench.reference.peers.registry"}
    assert worker.lent(errors) == set()
