"""Which tests reach a line, how long each takes and whether it passes, recorded in a run of the suite or a part of it.

Coverage does not see compiled code. A line of a kernel counts as reached by the tests that reach the Python functions
of its module, such as ``prepare``. A line that runs only at import, or once because of a cache, counts as reached by
all tests that reach the module; so does every line of a file that has changed since.
"""

from __future__ import annotations

import ast
import json
import multiprocessing
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache, cached_property
from pathlib import Path

import pytest
from coverage import Coverage, CoverageData
from score import digest

#: Folders whose coverage is recorded.
FOLDERS = ("integrators", "reference", "benchmarks", "phasebench")
RUN, SETUP = "run", "setup"


def _computed() -> float:
    """CPU seconds of this process and its children, which other load on the machine does not change."""
    return sum(os.times()[:4])


@cache
def often(code: str) -> frozenset[int]:
    """Lines that run on every call: those inside functions without a cache."""

    def lines(node: ast.AST, called: bool) -> Iterator[int]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef):
                once = any("cache" in ast.unparse(d) for d in child.decorator_list)
                yield from (line for part in child.body for line in lines(part, not once))
            else:
                yield from lines(child, called)
        if called and hasattr(node, "lineno"):
            yield from range(node.lineno, node.end_lineno + 1)

    return frozenset(lines(ast.parse(code), False))


class Recorder:
    """Pytest plugin that tells Coverage.py which test runs and records the seconds of each."""

    def __init__(self, coverage: Coverage):
        self.coverage, self.tests, self.fixtures = coverage, {}, {}

    def pytest_runtest_setup(self, item) -> None:
        """Switch the context to the setup of the test."""
        self.coverage.switch_context(f"{item.nodeid}|{SETUP}")

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request):
        """Record the time of a fixture, which counts for every test that uses it."""
        began = _computed()
        made = yield
        key = request.node.nodeid.partition("::")[0], fixturedef.argname
        self.fixtures[key] = max(_computed() - began, self.fixtures.get(key, 0.0))
        return made

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item):
        """Record the time of the test itself."""
        self.coverage.switch_context(f"{item.nodeid}|{RUN}")
        began = _computed()
        try:
            return (yield)
        finally:
            self.tests[item.nodeid] = {"fixtures": list(item.fixturenames), "seconds": _computed() - began}

    def pytest_runtest_logreport(self, report) -> None:
        """Record whether the test failed."""
        of = self.tests.setdefault(report.nodeid, {})
        of["failed"] = of.get("failed", False) or report.failed

    def costs(self) -> dict[str, dict]:
        """Test -> seconds with its fixtures, and whether it failed."""
        return {test: {"seconds": self._seconds(test, of), "failed": of["failed"]} for test, of in self.tests.items()}

    def _seconds(self, test: str, of: dict) -> float:
        file = test.partition("::")[0]
        makers = [(place, name) for name in of.get("fixtures", ()) for place in (file, "")]
        return of.get("seconds", 0.0) + sum(self.fixtures.get(made, 0.0) for made in makers)


def _record(database: str, root: str, tests: list[str]) -> None:
    """Run tests under Coverage.py and add to the database which lines they reach and their seconds."""
    folders = [f"{root}/{folder}/*" for folder in FOLDERS]
    coverage = Coverage(data_file=database, include=folders, config_file=False)
    coverage.load()
    coverage.start()
    recorder = Recorder(coverage)
    pytest.main(["-q", "-p", "no:cacheprovider", *tests], plugins=[recorder])
    coverage.stop()
    coverage.save()
    kept = Path(database).with_suffix(".json")
    known = json.loads(kept.read_text()) if kept.exists() else {"tests": {}, "files": {}}
    known["tests"] |= recorder.costs()
    for file in coverage.get_data().measured_files():
        known["files"].setdefault(file, digest(Path(file)))
    kept.write_text(json.dumps(known))


class Reach:
    """Which tests reach which line, as recorded in a coverage database.

    Parameters
    ----------
    database : path of the coverage database
    root : root of the project
    """

    def __init__(self, database: Path, root: Path):
        self.database, self.root, self._lines = database, root, {}

    def measure(self, tests: list[str]) -> None:
        """Run tests in a subprocess and add what they reach to the database."""
        self.database.parent.mkdir(parents=True, exist_ok=True)
        process = multiprocessing.get_context("spawn").Process(
            target=_record, args=(str(self.database), str(self.root), tests)
        )
        process.start()
        process.join()

    @cached_property
    def _data(self) -> CoverageData:
        data = CoverageData(str(self.database))
        data.read()
        return data

    @cached_property
    def _known(self) -> dict:
        kept = self.database.with_suffix(".json")
        return json.loads(kept.read_text()) if kept.exists() else {"tests": {}, "files": {}}

    @cached_property
    def _names(self) -> dict[str, str]:
        return {str(Path(f).resolve()): f for f in self._data.measured_files()}

    @property
    def known(self) -> list[str]:
        """Ids of the recorded tests."""
        return list(self._known["tests"])

    def seconds(self, test: str) -> float:
        """Seconds of a test with its fixtures; 1 if unknown."""
        return self._known["tests"].get(test, {}).get("seconds", 1.0)

    def tests(self, path: str, line: int) -> list[str]:
        """Passing tests that reach a line of a file; those that reach any line of it if none is known for the line."""
        file = (self.root / path).resolve()
        name = self._names.get(str(file))
        if name is None:
            return []
        if name not in self._lines:
            self._lines[name] = self._data.contexts_by_lineno(name)
        by_line, same = self._lines[name], self._known["files"].get(name) == digest(file)
        found = self._asked(by_line.get(line, ()) if same and line in often(file.read_text()) else ())
        found = found or self._asked({c for contexts in by_line.values() for c in contexts})
        return self._passing(found)

    def named(self, names: list[str]) -> list[str]:
        """Recorded passing tests among the names, each a file or a test with or without its parameters."""
        return self._passing(t for t in self.known if {t, t.partition("[")[0], t.partition("::")[0]} & set(names))

    def _passing(self, tests: Iterable[str]) -> list[str]:
        return [test for test in tests if not self._known["tests"].get(test, {}).get("failed")]

    @cached_property
    def _by_file(self) -> dict[str, list[str]]:
        by_file = defaultdict(list)
        for test in self._known["tests"]:
            by_file[test.partition("::")[0]].append(test)
        return by_file

    def _asked(self, contexts) -> list[str]:
        """Tests of coverage contexts such as ``tests/a.py::test|run``; a fixture counts for all tests of its file."""
        found = set()
        for context in contexts:
            test, _, phase = context.rpartition("|")
            if phase == RUN:
                found.add(test)
            elif phase == SETUP:
                found |= {test, *self._by_file[test.partition("::")[0]]}
        return sorted(found)
