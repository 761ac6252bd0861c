"""Which tests reach a line, by Coverage.py: kept in a database from one run of the whole suite, or of a part of it.

Compiled code is not seen.  A line of a kernel is reached by the tests that reach its module's Python functions, such as
``prepare``; a line that only runs at import is reached by all tests that reach the module.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections import defaultdict
from functools import cached_property
from pathlib import Path

from coverage import CoverageData

#: What is looked at.
FOLDERS = ("integrators", "reference", "benchmarks", "phasebench")
#: As many tests are asked by name; of more the files are.
NAMED = 60


class Reach:
    """What a database says.

    Parameters
    ----------
    database : its path
    root : of the project
    """

    def __init__(self, database: Path, root: Path):
        self.database, self.root = database, root

    def measure(self, tests: list[str]) -> None:
        """Run tests and keep which lines each of them reaches, besides what is known of others."""
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        command += [
            *(f"--cov={self.root / folder}" for folder in FOLDERS),
            "--cov-context=test",
            "--cov-append",
            "--cov-report=",
            "--cov-config=/dev/null",
        ]
        self.database.parent.mkdir(parents=True, exist_ok=True)
        environment = os.environ | {"COVERAGE_FILE": str(self.database)}
        subprocess.run(command, cwd=self.root, env=environment, check=False)

    @cached_property
    def _data(self) -> CoverageData:
        data = CoverageData(str(self.database))
        data.read()
        return data

    @cached_property
    def _names(self) -> dict[str, str]:
        return {str(Path(f).resolve()): f for f in self._data.measured_files()}

    def tests(self, path: str, line: int) -> list[str]:
        """The tests that reach a line of a file, or else those that reach the file."""
        name = self._names.get(str((self.root / path).resolve()))
        if name is None:
            return []
        by_line = self._data.contexts_by_lineno(name)
        found = _ids(by_line.get(line, ())) or _ids(c for contexts in by_line.values() for c in contexts)
        return found if len(found) <= NAMED else sorted({test.partition("::")[0] for test in found})


def _ids(contexts) -> list[str]:
    """The tests of contexts such as ``tests/a.py::test|run``, each file's together."""
    by_file = defaultdict(set)
    for context in contexts:
        test, _, phase = context.rpartition("|")
        if test and phase == "run":
            by_file[test.partition("::")[0]].add(test)
    return [test for file in sorted(by_file) for test in sorted(by_file[file])]
