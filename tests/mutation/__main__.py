"""Mutation of the suite by itself: ``python tests/mutation PATH ...`` changes the files one place at a time.

Each mutant is written into a copy of the project, the tests that reach its line are run there, and those that no test
notices are printed.  A survivor that changes nothing anybody could notice stands in ``equivalent.toml`` with the
argument; any other is a test that is missing.  Needs the extra ``mutation``.

    python tests/mutation --reach tests/benchmarks benchmarks/experiments/drift/page.py
    python tests/mutation --sample 40 integrators/families
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import child
from mutants import Mutant, mutants
from reach import Reach

ROOT = Path(__file__).parents[2]
CHILDREN = multiprocessing.get_context("forkserver")
KEPT = ROOT / ".mutation"
ARGUED = Path(__file__).with_name("equivalent.toml")
KILLED, SURVIVED, UNREACHED, ARGUED_EQUIVALENT = "killed", "survived", "not reached", "argued equivalent"
#: Seconds after which a mutant has hung, and is noticed.
PATIENCE = 300


def arguments() -> argparse.Namespace:
    """Of the command."""
    parser = argparse.ArgumentParser(prog="python tests/mutation", description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="*", help="files or folders, from the root of the project")
    parser.add_argument("--reach", nargs="+", default=[], metavar="TESTS", help="first record what these tests reach")
    parser.add_argument("--sample", type=int, help="so many mutants of each file, chosen by the seed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    return parser.parse_args()


def files(paths: list[str]) -> list[str]:
    """The modules that paths stand for."""
    found = []
    for path in paths:
        whole = ROOT / path
        members = [whole] if whole.is_file() else sorted(whole.rglob("*.py"))
        found += [str(p.relative_to(ROOT)) for p in members if p.name != "__init__.py" and "bench_" not in p.name]
    return found


def copied(folder: Path) -> Path:
    """A copy of the project to change."""
    for name in subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file():
            shutil.copy2(ROOT / name, target)
    child.redirect(ROOT, folder)
    return folder


def change(file: Path, text: str) -> None:
    """Write a module; its bytecode is told from another's by the time in seconds, which is not enough here."""
    file.write_text(text)
    for stale in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
        stale.unlink()


def judged(mutant: Mutant, tests: list[str], copy: Path) -> str:
    """Whether one of the tests notices a mutant."""
    file = copy / mutant.path
    original = file.read_text()
    try:
        change(file, mutant.code(ROOT))
        process = CHILDREN.Process(target=child.run, args=(str(ROOT), str(copy), tests))
        process.start()
        process.join(PATIENCE)
        if process.is_alive():
            process.kill()
            process.join()
        return KILLED if process.exitcode else SURVIVED
    finally:
        change(file, original)


def main() -> int:
    """Judge the mutants; 1 where one survives."""
    CHILDREN.set_forkserver_preload(["child", *child.PRELOADED])
    asked, reach = arguments(), Reach(KEPT / "reach.sqlite", ROOT)
    if asked.reach:
        reach.measure(asked.reach)
    argued = {of["mutant"]: of["why"] for of in tomllib.loads(ARGUED.read_text()).get("equivalent", [])}
    todo: list[Mutant] = []
    rng = random.Random(asked.seed)
    for path in files(asked.paths):
        of_file = mutants(ROOT, path)
        todo += of_file if asked.sample is None else rng.sample(of_file, min(asked.sample, len(of_file)))
    counts = dict.fromkeys((KILLED, ARGUED_EQUIVALENT, SURVIVED, UNREACHED), 0)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(asked.jobs) as pool:
        copies: SimpleQueue = SimpleQueue()
        for k in range(asked.jobs):
            copies.put(copied(Path(folder) / str(k)))

        def judge(mutant: Mutant) -> tuple[Mutant, str]:
            if mutant.id in argued:
                return mutant, ARGUED_EQUIVALENT
            tests = reach.tests(mutant.path, mutant.line)
            if not tests:
                return mutant, UNREACHED
            copy = copies.get()
            try:
                return mutant, judged(mutant, tests, copy)
            finally:
                copies.put(copy)

        for done, (mutant, said) in enumerate(pool.map(judge, todo), 1):
            counts[said] += 1
            if said in (SURVIVED, UNREACHED):
                print(f"{said}: line {mutant.line} of {mutant.id}", flush=True)
            left = (time.monotonic() - began) / done * (len(todo) - done)
            print(f"\r{done} of {len(todo)}, {left:.0f} s left ", end="", file=sys.stderr, flush=True)
    print(f"\n{len(todo)} mutants: " + ", ".join(f"{n} {said}" for said, n in counts.items()))
    return 1 if counts[SURVIVED] or counts[UNREACHED] else 0


if __name__ == "__main__":
    sys.exit(main())
