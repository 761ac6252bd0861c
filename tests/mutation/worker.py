"""A process that has imported the project from a copy and judges mutants of its files in child processes.

A mutant that changes only functions is judged in a child of a session that has already collected the tests: the code of
the functions is replaced in place. A mutant of code that runs at import is judged after the module, and all that import
it, are imported again; so is a mutant of a function that was called before the tests began, if no test noticed it in
place. A mutant of a compiled file is judged in a process that has not yet imported the project.

The cache is that of the unmodified project where functions are neither compiled nor mutated. With kernels as Python
functions (`PLAIN`), each mutant has a cache of its own: a copy of the project's, or an empty one if the mutated file
generates the functions that are cached.
"""

from __future__ import annotations

import ast
import cProfile
import gc
import importlib
import inspect
import marshal
import math
import multiprocessing
import os
import resource
import shutil
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import cache_from_source
from itertools import pairwise
from pathlib import Path

from swap import functions, place, swaps

PRELOADED = (
    "pytest",
    "_pytest.runner",
    "numpy",
    "scipy.stats",
    "scipy.integrate",
    "sympy",
    "numba",
    "pandas",
    "matplotlib.pyplot",
    "mpmath",
    "tabulate",
    "typer.testing",
    "hypothesis",
)
PROJECT = ("phasebench.benchmarks.report", "phasebench.benchmarks.cli", "phasebench.benchmarks.certificate.plugin")
#: A mutant counts as hung, and so as noticed, after PATIENCE + TIMES * (seconds of its tests) seconds of CPU time.
PATIENCE, TIMES = 40, 8
#: A child that waits counts as hung after this many times its CPU limit in wall-clock time; the machine may be busy.
WAITING = 10
#: Folders with functions that are compiled: replacing their code in place has no effect.
COMPILED = (
    "integrators/compile/",
    "integrators/values/",
    "integrators/stepping/",
    "integrators/families/",
    "integrators/systems/",
)
#: Folders of the code that generates the functions in the cache.
GENERATING = ("integrators/compile/", "integrators/systems/")
#: Environment in which nothing is compiled.
PLAIN = {"NUMBA_DISABLE_JIT": "1"}
#: Verdict on a mutant that may act only if it is present at import.
UNSURE = "unsure"
#: Records the functions that are called before the tests run.
CALLED = cProfile.Profile()
FORK = multiprocessing.get_context("fork")


@dataclass(frozen=True)
class Job:
    """A mutant and the tests that may notice it.

    Attributes
    ----------
    path : the mutated file
    code : text of the mutated file
    tests : ids of the tests, in the order in which they run
    files : test files with a test that may notice any mutant of the file
    known : tests with a recorded reach; other tests of these files run as well
    seconds : total time of the tests
    """

    path: str
    code: str
    tests: tuple[str, ...]
    files: tuple[str, ...]
    known: frozenset[str]
    seconds: float = 0.0

    @property
    def patience(self) -> float:
        """CPU seconds after which the tests count as hung."""
        return PATIENCE + TIMES * self.seconds

    @property
    def own(self) -> tuple[str, ...]:
        """Files of the tests, or `files` if there are no tests."""
        return tuple(sorted({test.partition("::")[0] for test in self.tests})) or self.files


def is_plain() -> bool:
    """Whether nothing is compiled in this process."""
    return PLAIN.items() <= os.environ.items()


def is_compiled(path: str) -> bool:
    """Whether functions of the file may become part of compiled code in this process."""
    return path.startswith(COMPILED) and not is_plain()


def serve(copy: str, connection) -> None:
    """Receive jobs until None arrives; send back for each the test that notices the mutant, or None."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    os.chdir(copy)
    # The copy precedes the editable install on the path, here and in the subprocesses of tests.
    os.environ |= {"PYTHONPATH": copy}
    sys.path.insert(0, copy)
    worker = Worker(Path(copy))
    while (job := connection.recv()) is not None:
        connection.send(worker.judge(job))
    worker.close()


class Worker:
    """Judges mutants in a copy of the project.

    Parameters
    ----------
    copy : folder of the copy
    """

    def __init__(self, copy: Path):
        self.copy, self.session, self.about = copy, None, None
        self.cache, self.kept = copy / ".mutation" / "cache", None

    def judge(self, job: Job) -> str | None:
        """The test that notices a mutant, ``hung`` or ``died``, or None."""
        original = (self.copy / job.path).read_text()
        if is_compiled(job.path):
            return self._changed(job, original, lambda: forked(alone, job, patience=job.patience))
        if "phasebench" not in sys.modules:
            self._imports()
        found = self._changed(job, original, lambda: self._swapped(job, original))
        if found != UNSURE:
            return found
        return self._changed(job, original, lambda: forked(anew, job, patience=job.patience))

    def _imports(self) -> None:
        """Import the project."""
        CALLED.enable()
        for name in PROJECT:
            importlib.import_module(name)
        # Read before PHASEBENCH_CACHE is set: this is the cache of the unmodified project.
        kept = importlib.import_module("phasebench.integrators.compile.cache").folder()
        if is_plain():
            self.kept = kept
            os.environ["PHASEBENCH_CACHE"] = str(self.cache)
        for module in project().values():
            imported(module)  # cached here, so that children need not parse the files again
        gc.freeze()

    def _changed(self, job: Job, original: str, run: Callable[[], str | None]) -> str | None:
        """Result of ``run`` while the file in the copy holds the mutant, for subprocesses of tests that read it."""
        if self.kept and not job.path.startswith(GENERATING):
            lend(self.kept, self.cache / self.kept.name)
        try:
            change(self.copy / job.path, job.code)
            return run()
        finally:
            change(self.copy / job.path, original)
            shutil.rmtree(self.cache, ignore_errors=True)  # what the mutant has cached

    def _swapped(self, job: Job, original: str) -> str | None:
        """Verdict on a mutant whose functions are replaced in place; `UNSURE` if it must be present at import."""
        file = str(self.copy / "phasebench" / job.path.removeprefix("phasebench/"))  # its import path
        changes = swaps(*(compile(code, file, "exec", dont_inherit=True) for code in (original, job.code)))
        if changes is None:
            return UNSURE
        if self.about != (job.path, job.files):
            self.close()
            self.session, theirs = FORK.Pipe()
            self.about = (job.path, job.files)
            FORK.Process(target=_session, args=(theirs, file, job.files), daemon=False).start()
            theirs.close()
        codes = [(where, marshal.dumps(code)) for where, code in changes]
        self.session.send((job.patience, job.tests, job.known, codes))
        return self.session.recv()

    def close(self) -> None:
        """End the child process that has collected tests."""
        if self.session is not None:
            self.session.send(None)
        self.session = self.about = None


def change(file: Path, text: str) -> None:
    """Write a module and delete its bytecode, whose time stamp in whole seconds may not show that it is stale."""
    file.write_text(text)
    for stale in Path(cache_from_source(file)).parent.glob(f"{file.stem}.*.pyc"):
        stale.unlink(missing_ok=True)


def lend(kept: Path, place: Path) -> None:
    """Copy all entries of the cache folder ``kept`` except machine code into the folder ``place``."""
    place.mkdir(parents=True, exist_ok=True)
    for entry in kept.iterdir() if kept.is_dir() else ():
        if entry.suffix in (".py", ".json"):
            shutil.copy2(entry, place)


def forked(run: Callable[..., str | None], *arguments, patience: float = PATIENCE) -> str | None:
    """Result of a function in a child process; ``hung`` or ``died`` if there is none. Its subprocesses end with it."""
    ours, theirs = FORK.Pipe(duplex=False)
    process = FORK.Process(target=_tell, args=(theirs, patience, run, *arguments))
    process.start()
    theirs.close()
    try:
        # Polls count seconds in which this process runs; a wall clock would go on while all processes are stopped.
        return ours.recv() if any(ours.poll(1) for _ in range(round(WAITING * patience))) else "hung"
    except EOFError:
        process.join()
        return "hung" if process.exitcode == -signal.SIGXCPU else "died"
    finally:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            process.kill()
        process.join()
        ours.close()


def _tell(connection, patience: float, run, *arguments) -> None:
    os.setpgid(0, 0)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(patience), resource.RLIM_INFINITY))
    connection.send(run(*arguments))


class Collected:
    """Pytest plugin that passes the collected tests to a function instead of running them."""

    def __init__(self, loop: Callable):
        self.loop = loop

    def pytest_runtestloop(self, session) -> bool:
        """Call the function with {id: test} and whether a file failed to import."""
        self.loop({item.nodeid: item for item in session.items}, bool(session.testsfailed))
        return True


def collect(files: tuple[str, ...], loop: Callable) -> None:
    """Collect the tests of files and call `loop` with them, see `Collected`."""
    import pytest

    scratch = Path(".mutation") / "scratch"
    scratch.parent.mkdir(exist_ok=True)
    # Failures need no explanation.
    options = ["-q", "-p", "no:cacheprovider", "--capture=sys", "--assert=plain", "--tb=native"]
    pytest.main([*options, f"--basetemp={scratch}", *files], plugins=[Collected(loop)])


def noticed(items: dict, tests: tuple[str, ...], known: frozenset[str]) -> str | None:
    """Run the tests in order, then those with no recorded reach; the id of the first that fails, or None."""
    from _pytest.runner import runtestprotocol

    asked = [items[test] for test in (*tests, *(id for id in items if id not in known)) if test in items]
    for item, following in pairwise([*asked, None]):
        if any(report.failed for report in runtestprotocol(item, log=False, nextitem=following)):
            return item.nodeid
    return None


def _session(connection, file: str, files: tuple[str, ...]) -> None:
    """Collect the tests of files once, then judge in a child process each set of changed functions that is received."""

    def loop(items: dict, failed: bool) -> None:
        CALLED.disable()
        called = {place(of.code) for of in CALLED.getstats() if getattr(of.code, "co_filename", None) == file}
        gc.unfreeze()
        made = functions(file)
        gc.freeze()  # else the child's garbage collector would write to every memory page and so copy it
        while (asked := connection.recv()) is not None:
            patience, *asked = asked
            found = forked(_with, made, items, *asked, patience=patience)
            sure = found or all(where in made and where not in called for where, _ in asked[-1])
            connection.send(found if sure else UNSURE)

    collect(files, loop)


def _with(made: dict, items: dict, tests: tuple[str, ...], known: frozenset[str], changes: list) -> str | None:
    """Replace the code of functions in place, run the tests and return the first one that fails, or None."""
    for where, code in changes:
        for function in made.get(where, ()):
            function.__code__ = marshal.loads(code)
    return noticed(items, tests, known)


def alone(job: Job) -> str | None:
    """The first test of a job that fails in a pytest session of its own, or None; "collection" if an import fails."""
    found: list[str | None] = ["collection"]

    def loop(items: dict, failed: bool) -> None:
        if not failed:
            found[0] = noticed(items, job.tests, job.known)

    collect(job.own, loop)
    return found[0]


def anew(job: Job) -> str | None:
    """The first test of a job that fails after the mutated file and its importers are imported again, or None."""
    CALLED.disable()
    forget(Path(job.path).resolve())
    return alone(job)


def forget(file: Path) -> None:
    """Unload a module and all that import it, directly or not."""
    modules = project()
    names = {name: (imported(m) | lent(m)) & set(modules) for name, m in modules.items()}
    gone = {name for name, m in modules.items() if Path(m.__file__).resolve() == file}
    while more := {name for name, needs in names.items() if needs & gone} - gone:
        gone |= more
    for name in gone:
        del sys.modules[name]
        parent, _, last = name.rpartition(".")
        if last in vars(sys.modules.get(parent, object)):
            delattr(sys.modules[parent], last)


def project() -> dict:
    """{name: loaded module} of the project."""
    found = {name: m for name, m in sys.modules.items() if name.partition(".")[0] == "phasebench"}
    return {name: m for name, m in found.items() if getattr(m, "__file__", None)}


def lent(module) -> set[str]:
    """Modules from which a package imports lazily; no import statement in its text names them."""
    asked = vars(module).get("__getattr__")
    homes = inspect.getclosurevars(asked).nonlocals.get("homes", {}) if asked else {}
    return {f"{module.__name__}.{home}" for home in homes.values()}


def imported(module) -> set[str]:
    """Modules that the text of a module may import."""
    return _imported(module.__file__, module.__name__ if hasattr(module, "__path__") else module.__package__)


@cache
def _imported(file: str, package: str) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(Path(file).read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            base = ".".join(package.split(".")[: len(package.split(".")) + 1 - node.level]) if node.level else ""
            origin = ".".join(filter(None, [base, node.module]))
            found |= {origin, *(f"{origin}.{alias.name}" for alias in node.names)}
    return found
