"""A process that has imported the project from a copy, and judges mutants of its files in children.

A mutant that changes a function is put in the function's place, in a child of a session that has collected the tests.
One that changes what runs at import is imported, with what imports it; so is one of a function that was called before
the tests run, where none noticed.  One of a file that is compiled begins without the project.

What the cache keeps is that of the project as it is, for what neither compiles nor is compiled.  Where kernels are
changed as Python functions (`PLAIN`), each mutant has a cache of its own: with what the project keeps, or empty where
the mutant is of what generates it.
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
#: A mutant has hung, and is noticed, after it has computed for so many seconds and so many times what its tests take.
PATIENCE, TIMES = 40, 8
#: One that waits has hung after so many times as long by the clock, which counts what else the machine does.
WAITING = 10
#: Folders of which functions are compiled: a function that is changed would not be.
COMPILED = ("integrators/engine/", "integrators/families/", "integrators/systems/")
#: Folders of what generates the functions that the cache keeps.
GENERATING = ("integrators/engine/", "integrators/systems/")
#: What makes a process compile nothing.
PLAIN = {"NUMBA_DISABLE_JIT": "1"}
#: What makes Python import the project from a copy of it, which the editable install does not know.
REDIRECT = """import sys
for name, module in list(sys.modules.items()):
    if name.startswith("__editable___phasebench"):
        module.MAPPING.update({k: v.replace(ROOT, COPY) for k, v in module.MAPPING.items()})
"""
#: Said of a mutant that may have to be there at import.
UNSURE = "unsure"
#: What is called before the tests run.
CALLED = cProfile.Profile()
FORK = multiprocessing.get_context("fork")


@dataclass(frozen=True)
class Job:
    """A mutant and the tests that may notice it.

    Attributes
    ----------
    path : of the file
    code : the changed file
    tests : in the order in which they are asked
    files : of all the tests that may notice another mutant of the file
    known : the tests of which it is known what they reach; any other of these files is asked as well
    seconds : what the tests take together
    """

    path: str
    code: str
    tests: tuple[str, ...]
    files: tuple[str, ...]
    known: frozenset[str]
    seconds: float = 0.0

    @property
    def patience(self) -> float:
        """Seconds that the tests may compute."""
        return PATIENCE + TIMES * self.seconds

    @property
    def own(self) -> tuple[str, ...]:
        """The files of the tests; of none, all."""
        return tuple(sorted({test.partition("::")[0] for test in self.tests})) or self.files


def is_plain() -> bool:
    """Whether nothing is compiled in this process."""
    return PLAIN.items() <= os.environ.items()


def is_compiled(path: str) -> bool:
    """Whether a function of the file may be part of compiled code here."""
    return path.startswith(COMPILED) and not is_plain()


def write_redirect(root: Path, copy: Path) -> None:
    """Write what redirects processes that tests start."""
    site = copy / ".mutation" / "sitecustomize.py"
    site.parent.mkdir(exist_ok=True)
    site.write_text(REDIRECT.replace("ROOT", repr(str(root))).replace("COPY", repr(str(copy))))


def serve(root: str, copy: str, connection) -> None:
    """Judge the mutants that arrive: the test that notices each, or None."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    os.chdir(copy)
    os.environ |= {"PYTHONPATH": f"{copy}/.mutation"}
    exec(REDIRECT, {"ROOT": root, "COPY": copy})
    worker = Worker(Path(copy))
    while (job := connection.recv()) is not None:
        connection.send(worker.judge(job))
    worker.close()


class Worker:
    """What judges mutants on a copy of the project.

    Parameters
    ----------
    copy : its folder
    """

    def __init__(self, copy: Path):
        self.copy, self.session, self.about = copy, None, None
        self.cache, self.kept = copy / ".mutation" / "cache", None

    def judge(self, job: Job) -> str | None:
        """The test that notices a mutant, ``hung``, or None."""
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
        # From here on the version is that of the project as it is.
        kept = importlib.import_module("phasebench.integrators.engine.cache").folder()
        if is_plain():
            self.kept = kept
            os.environ["PHASEBENCH_CACHE"] = str(self.cache)
        for module in project().values():
            imported(module)  # which children need not read again
        gc.freeze()

    def _changed(self, job: Job, original: str, run: Callable[[], str | None]) -> str | None:
        """What comes of it while the file is changed, which a process that a test starts would read."""
        if self.kept and not job.path.startswith(GENERATING):
            lend(self.kept, self.cache / self.kept.name)
        try:
            change(self.copy / job.path, job.code)
            return run()
        finally:
            change(self.copy / job.path, original)
            shutil.rmtree(self.cache, ignore_errors=True)  # it holds what the mutant has made

    def _swapped(self, job: Job, original: str) -> str | None:
        file = str(self.copy / job.path)
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
        """End the session."""
        if self.session is not None:
            self.session.send(None)
        self.session = self.about = None


def change(file: Path, text: str) -> None:
    """Write a module; its bytecode is told from another's by the time in seconds, which is not enough here."""
    file.write_text(text)
    for stale in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
        stale.unlink(missing_ok=True)


def lend(kept: Path, place: Path) -> None:
    """Copy what a cache keeps, but for machine code, into another."""
    place.mkdir(parents=True, exist_ok=True)
    for entry in kept.iterdir() if kept.is_dir() else ():
        if entry.suffix in (".py", ".json"):
            shutil.copy2(entry, place)


def forked(run: Callable[..., str | None], *arguments, patience: float = PATIENCE) -> str | None:
    """What a function returns in a child, and what it started with it; ``hung`` or ``died`` else."""
    ours, theirs = FORK.Pipe(duplex=False)
    process = FORK.Process(target=_tell, args=(theirs, patience, run, *arguments))
    process.start()
    theirs.close()
    try:
        # Seconds that this process lives, not those of the clock: all may have been stopped meanwhile.
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
    """A session that has collected tests: what it runs instead of them."""

    def __init__(self, loop: Callable):
        self.loop = loop

    def pytest_runtestloop(self, session) -> bool:
        """Run what was asked; a file that cannot be imported has no tests."""
        self.loop({item.nodeid: item for item in session.items}, bool(session.testsfailed))
        return True


def collect(files: tuple[str, ...], loop: Callable) -> None:
    """Collect the tests of files, then do something with them."""
    import pytest

    scratch = Path(".mutation") / "scratch"
    # A test need not say why it failed.
    options = ["-q", "-p", "no:cacheprovider", "--capture=sys", "--assert=plain", "--tb=native"]
    pytest.main([*options, f"--basetemp={scratch}", *files], plugins=[Collected(loop)])


def noticed(items: dict, tests: tuple[str, ...], known: frozenset[str]) -> str | None:
    """The first of the tests that fails, new ones last."""
    from _pytest.runner import runtestprotocol

    asked = [items[test] for test in (*tests, *(id for id in items if id not in known)) if test in items]
    for item, following in pairwise([*asked, None]):
        if any(report.failed for report in runtestprotocol(item, log=False, nextitem=following)):
            return item.nodeid
    return None


def _session(connection, file: str, files: tuple[str, ...]) -> None:
    """Collect tests, and judge the changed functions that arrive."""

    def loop(items: dict, failed: bool) -> None:
        CALLED.disable()
        called = {place(of.code) for of in CALLED.getstats() if getattr(of.code, "co_filename", None) == file}
        gc.unfreeze()
        made = functions(file)
        gc.freeze()  # else a child's collector would write to every page, and so copy it
        while (asked := connection.recv()) is not None:
            patience, *asked = asked
            found = forked(_with, made, items, *asked, patience=patience)
            sure = found or all(where in made and where not in called for where, _ in asked[-1])
            connection.send(found if sure else UNSURE)

    collect(files, loop)


def _with(made: dict, items: dict, tests: tuple[str, ...], known: frozenset[str], changes: list) -> str | None:
    for where, code in changes:
        for function in made.get(where, ()):
            function.__code__ = marshal.loads(code)
    return noticed(items, tests, known)


def alone(job: Job) -> str | None:
    """The first of the tests that fails in a session of its own."""
    found: list[str | None] = ["collection"]

    def loop(items: dict, failed: bool) -> None:
        if not failed:
            found[0] = noticed(items, job.tests, job.known)

    collect(job.own, loop)
    return found[0]


def anew(job: Job) -> str | None:
    """The first of the tests that fails where a file is imported again, and all that imports it."""
    CALLED.disable()
    forget(Path(job.path).resolve())
    return alone(job)


def forget(file: Path) -> None:
    """Unload a module and what imports it."""
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
    """The modules of the project, by name."""
    found = {name: m for name, m in sys.modules.items() if name.partition(".")[0] == "phasebench"}
    return {name: m for name, m in found.items() if getattr(m, "__file__", None)}


def lent(module) -> set[str]:
    """The modules of a package from which it keeps what it was asked for; no import of it names them."""
    asked = vars(module).get("__getattr__")
    homes = inspect.getclosurevars(asked).nonlocals.get("homes", {}) if asked else {}
    return {f"{module.__name__}.{home}" for home in homes.values()}


def imported(module) -> set[str]:
    """The modules that one may import, by its text."""
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
