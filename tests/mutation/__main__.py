"""Mutation of the suite by itself: ``python tests/mutation PATH ...`` changes the files one place at a time.

Each mutant is tried in a copy of the project: the tests that reach the changed line are run, and mutants that no test
notices are printed. Each of them shows a missing test or behaves like the original. The score is stored in
``score.csv``. Needs the extra ``mutation``.

    python tests/mutation --reach tests/benchmarks benchmarks/experiments/drift/page.py
    python tests/mutation --plain --within 1 --sample 40 integrators/families

No test is recorded as reaching a file that runs only at import, such as a table: ``--by TESTS`` names the tests that
judge its mutants; no others are run.

With ``--plain`` nothing is compiled, neither while the reach is recorded nor while mutants are judged: a kernel runs,
and is mutated, as the Python function that it is written as. A mutant that only compilation would reject survives then
and is judged without ``--plain``, which recompiles every kernel for each mutant of one.
"""

from __future__ import annotations

import argparse
import ast
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path
from threading import Lock

import score
import worker
from mutants import Mutant, mutants
from reach import Reach
from tabulate import tabulate

ROOT = Path(__file__).parents[2]
CHILDREN = multiprocessing.get_context("forkserver")
KEPT = ROOT / ".mutation"
KILLED, SURVIVED, UNREACHED = "killed", "survived", "not reached"
FAILING = "files of failing tests"


def arguments() -> argparse.Namespace:
    """Parsed arguments of the command line."""
    parser = argparse.ArgumentParser(prog="python tests/mutation", description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="*", help="files or folders, from the root of the project")
    parser.add_argument("--reach", nargs="+", default=[], metavar="TESTS", help="first record what these tests reach")
    parser.add_argument("--by", nargs="+", default=[], metavar="TESTS", help="ask these recorded tests alone")
    parser.add_argument("--sample", type=int, help="so many mutants of each file, in the order of the score")
    parser.add_argument("--again", action="store_true", help="only the survivors of the score")
    parser.add_argument("--within", type=float, default=20.0, metavar="SECONDS", help="ask no test that takes longer")
    parser.add_argument("--most", type=float, default=120.0, metavar="SECONDS", help="ask no more tests of a mutant")
    parser.add_argument("--plain", action="store_true", help="compile nothing: kernels are changed as Python functions")
    parser.add_argument("--score", action="store_true", help="print the score that is kept, and no more")
    parser.add_argument("--jobs", type=int, default=1)
    return parser.parse_args()


def has_code(path: Path) -> bool:
    """Whether a module can have mutants: an __init__.py without any function has none."""
    tree = ast.parse(path.read_text()) if path.name == "__init__.py" else None
    return tree is None or any(isinstance(node, ast.FunctionDef) for node in ast.walk(tree))


def files(paths: list[str]) -> list[str]:
    """Modules at the given files and below the given folders, without benches."""
    found = []
    for path in paths:
        whole = ROOT / path
        members = [whole] if whole.is_file() else sorted(whole.rglob("*.py"))
        found += [str(p.relative_to(ROOT)) for p in members if "bench_" not in p.name and has_code(p)]
    return found


def copied(folder: Path) -> Path:
    """Copy the project into a folder and return it."""
    for name in subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).exists():
            shutil.copy2(ROOT / name, target, follow_symlinks=False)
    return folder


@contextmanager
def judge(folder: Path):
    """Start a process with a copy of the project; yield a function that sends it a job and returns the verdict."""
    ours, theirs = CHILDREN.Pipe()
    process = CHILDREN.Process(target=worker.serve, args=(str(copied(folder)), theirs))
    process.start()
    theirs.close()

    def ask(job: worker.Job) -> str | None:
        ours.send(job)
        return ours.recv()

    try:
        yield ask
    finally:
        ours.send(None)
        process.join()


class Trial:
    """The mutants of one file and the tests that judge them.

    Parameters
    ----------
    path : the file, from the root of the project
    reach : which tests reach which line
    asked : the parsed command-line arguments
    """

    def __init__(self, path: str, reach: Reach, asked: argparse.Namespace):
        self.path, self.reach, self.within, self.most = path, reach, asked.within, asked.most
        self.all = sorted(mutants(ROOT, path), key=lambda m: m.place)
        self.hash = score.digest(ROOT / path)  # at the start: the file may be edited during the run
        known = score.read().get(path)
        same = known is not None and (known.hash, known.mutants) == (self.hash, len(self.all))
        self.known = known if asked.again and same else None
        self.tried = self.all[: self.known.tried if self.known else asked.sample]
        self.named = reach.named(asked.by)
        self.files = tuple(sorted({t.partition("::")[0] for t in self._quick(self._may_notice(0))}))
        self.known_tests = frozenset(t for t in reach.known if t.partition("::")[0] in self.files)
        self.kills: Counter = Counter()

    def todo(self) -> list[Mutant]:
        """Mutants to judge: the sample, or with --again its survivors of last time."""
        return [m for m in self.tried if self.known is None or m.id in self.known.survived]

    def tests(self, mutant: Mutant) -> list[str]:
        """Tests to run on a mutant, the likeliest to fail first: those that killed other mutants, and quick ones."""

        def promise(test: str) -> float:
            return (1 + 20 * self.kills[mutant.where, test] + 5 * self.kills[test]) / (0.02 + self.reach.seconds(test))

        return self._affordable(mutant.line, promise)

    def _affordable(self, line: int, promise: Callable[[str], float]) -> list[str]:
        """Tests that may notice a change of a line, the most promising first, with a total time below --most."""
        found = sorted(self._quick(self._may_notice(line)), key=promise, reverse=True)
        spent = accumulate(map(self.reach.seconds, found))
        return [test for test, seconds in zip(found, spent, strict=True) if seconds <= self.most]

    def _may_notice(self, line: int) -> list[str]:
        return self.named or self.reach.tests(self.path, line)

    def _quick(self, tests: list[str]) -> list[str]:
        return [test for test in tests if self.reach.seconds(test) <= self.within]

    def failing(self, ask) -> str | None:
        """A test that fails on the unmodified file, or None; such a test would seem to notice every mutant."""
        tests = self._affordable(0, lambda test: -self.reach.seconds(test))
        code, seconds = (ROOT / self.path).read_text(), sum(map(self.reach.seconds, tests))
        return ask(worker.Job(self.path, code, tuple(tests), self.files, self.known_tests, seconds))

    def judged(self, mutant: Mutant, ask) -> str:
        """Verdict on a mutant: killed, survived, or not reached by any test. ``ask`` runs a job."""
        tests = self.tests(mutant)
        if not self.files:
            return UNREACHED
        seconds = sum(map(self.reach.seconds, tests))
        by = ask(worker.Job(mutant.path, mutant.code, tuple(tests), self.files, self.known_tests, seconds))
        if by is not None:
            self.kills.update([by, (mutant.where, by)])
        return KILLED if by else SURVIVED

    def score(self, said: dict[str, str]) -> score.Score:
        """The entry of ``score.csv`` from this run's verdicts, {mutant id: verdict}."""
        counts = Counter(said.values())
        survived = tuple(i for i, of in said.items() if of in (SURVIVED, UNREACHED))
        killed = len(self.tried) - len(survived) if self.known else counts[KILLED]
        return score.Score(self.path, self.hash, len(self.all), len(self.tried), killed, survived)


def tried(trial: Trial, ask) -> dict[str, str]:
    """Judge the mutants of a file, print those that no test notices, and return {mutant id: verdict}."""
    said, began = {}, time.monotonic()
    for mutant in trial.todo():
        said[mutant.id] = trial.judged(mutant, ask)
        if said[mutant.id] in (SURVIVED, UNREACHED):
            print(f"{said[mutant.id]}: line {mutant.line} of {mutant.id}", flush=True)
    each = (time.monotonic() - began) / max(len(said), 1)
    counts = ", ".join(f"{n} {of}" for of, n in Counter(said.values()).items())
    print(f"{trial.path}: {len(said)} of {len(trial.all)} mutants, {each:.2f} s each: {counts}", flush=True)
    return said


def main() -> int:
    """Judge the mutants; exit code 1 if one survives."""
    CHILDREN.set_forkserver_preload(["worker", *worker.PRELOADED])
    asked = arguments()
    reach = Reach(KEPT / ("plain.sqlite" if asked.plain else "reach.sqlite"), ROOT)
    if asked.plain:
        os.environ |= worker.PLAIN
    if asked.score:
        columns = ("file", "mutants", "tried", "killed", "survived", "")
        print(tabulate(score.table(score.read(), ROOT), columns))
        return 0
    if asked.reach:
        reach.measure(asked.reach)
    if unknown := [name for name in asked.by if not reach.named([name])]:
        print(f"not recorded, or they fail: {', '.join(unknown)}; --reach records tests", file=sys.stderr)
        return 2
    counts: Counter = Counter()
    paths = sorted(files(asked.paths), key=worker.is_compiled, reverse=True)  # compiled files first
    todo, alone = iter(paths), Lock()  # all threads take from one iterator; one at a time uses the score

    def work(folder: Path) -> None:
        with judge(folder) as ask:
            for path in todo:
                with alone:
                    trial = Trial(path, reach, asked)
                if trial.files and (test := trial.failing(ask)):
                    print(f"{trial.path}: not judged, as {test} fails without a change", flush=True)
                    with alone:
                        counts[FAILING] += 1
                    continue
                said = tried(trial, ask)
                with alone:
                    counts.update(said.values())
                    score.write(score.read() | {path: trial.score(said)})

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(asked.jobs) as pool:
        list(pool.map(work, [Path(folder) / str(k) for k in range(min(asked.jobs, len(paths)))]))
    print(f"{sum(counts.values())} mutants: " + ", ".join(f"{n} {said}" for said, n in counts.items()))
    return 1 if counts[SURVIVED] or counts[UNREACHED] or counts[FAILING] else 0


if __name__ == "__main__":
    sys.exit(main())
