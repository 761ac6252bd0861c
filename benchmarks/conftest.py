"""`pytest benchmarks`: measures what changed, compares with the stored tables, and writes the reports."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from pathlib import Path

import pytest

from phasebench.benchmarks.store import run, screen
from phasebench.benchmarks.store.cluster import Cluster
from phasebench.integrators.errors import InvalidInput

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
OUTCOME = pytest.StashKey[run.Outcome]()
WANTED = pytest.StashKey[frozenset]()
NOTES = pytest.StashKey[list]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of ``pytest benchmarks``."""
    group = parser.getgroup("phasebench")
    group.addoption("--quick", action="store_true", help="measure a small selection, reports to reports/quick")
    group.addoption(
        "--budget", type=float, metavar="SECONDS", default=run.BUDGET, help="what the run may cost (%(default)g)"
    )
    group.addoption("--dear", action="store_true", help="measure outdated numbers that take long, too")
    group.addoption("--times", action="store_true", help="measure outdated times, too, however long it takes")
    group.addoption("--all", action="store_true", help="measure every cell, however long it takes")
    group.addoption(
        "--seed", type=int, default=None, metavar="NUMBER", help="seed of the sample (default: the number of the day)"
    )
    group.addoption("--update-tables", action="store_true", help="re-record reference/tables, drop old rows")
    group.addoption(
        "--scheduler",
        metavar="ADDRESS",
        default=None,
        help="a Dask cluster that measures what is not timed: its address",
    )
    group.addoption(
        "--reports", metavar="FOLDER", default=None, help="a folder of reports (default: reports, or reports/quick)"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Let the option ``-k`` select measurements instead of test functions if each of its words is a name of `_names`.

    These are the names of methods, problems, experiments and the like.
    """
    config.stash[NOTES] = []
    config.stash[WANTED] = frozenset()
    words = [w for w in config.option.keyword.split() if w != "or"] if config.option.keyword else []
    if words and set(words) <= _names():
        config.stash[WANTED] = frozenset(words)
        config.option.keyword = ""


def _names() -> set[str]:
    """Return the names by which the option ``-k`` can select measurements.

    They are the ids of methods, of peers (integrators of other packages), of scenes (a problem with a time span and
    steps) and of questions (a problem with a quantity to be computed to given accuracies), and the names of the peers'
    packages, of problems and of studies.
    """
    from phasebench.benchmarks.problems import PROBLEMS
    from phasebench.benchmarks.problems.questions import QUESTIONS
    from phasebench.benchmarks.problems.scenes import SCENES
    from phasebench.benchmarks.studies.index import found
    from phasebench.integrators.registry import METHODS
    from phasebench.reference.peers import PEERS

    ids = {x.id for x in (*METHODS, *PEERS, *SCENES, *QUESTIONS)}
    return ids | {p.package for p in PEERS} | {*PROBLEMS, *found()}


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the pytest-benchmark functions unless an option --benchmark-* is given."""
    if not any(a.startswith("--benchmark") for a in config.invocation_params.args):
        asked = [i for i in items if "benchmark" not in i.fixturenames]
        config.hook.pytest_deselected(items=[i for i in items if "benchmark" in i.fixturenames])
        items[:] = asked


def _folder(config: pytest.Config) -> Path:
    quick = config.getoption("--quick")
    return Path(config.getoption("--reports") or ROOT / "reports" / ("quick" if quick else ""))


@pytest.fixture(scope="session")
def quick(pytestconfig: pytest.Config) -> bool:
    """True for a quick run (option --quick), which makes a small selection of the measurements."""
    return pytestconfig.getoption("--quick")


@pytest.fixture(scope="session")
def update(pytestconfig: pytest.Config) -> bool:
    """True if the reference tables in ``reference/tables`` are to be recorded anew (option --update-tables)."""
    return pytestconfig.getoption("--update-tables")


@pytest.fixture(scope="session")
def notes(pytestconfig: pytest.Config) -> list[str]:
    """Return the list of the lines to print at the end of the run; tests may append to the list."""
    return pytestconfig.stash[NOTES]


@pytest.fixture(scope="session")
def outcome(request: pytest.FixtureRequest, pytestconfig: pytest.Config, quick: bool, update: bool) -> run.Outcome:
    """Measure what the collected benchmark modules ask for, within the time budget; return what was measured.

    A module that has measurements lists them by its function ``cells``, as `Cell` objects.
    """
    modules = {item.module.__name__: item.module for item in request.session.items}
    cells = [c for m in modules.values() if hasattr(m, "cells") for c in m.cells(quick)]
    wanted = pytestconfig.stash[WANTED]
    selected = (lambda c: bool(wanted & {*c.names, c.experiment})) if wanted else None
    if quick and not wanted:
        cells = [c for c in cells if c.quick]
    capture = pytestconfig.pluginmanager.getplugin("capturemanager")
    with capture.global_and_fixture_disabled(), screen.progress(sys.stderr) as progress:
        address = pytestconfig.getoption("--scheduler")
        try:
            outcome = run.execute(
                cells,
                _folder(pytestconfig) / "data",
                selected=selected,
                budget=pytestconfig.getoption("--budget"),
                dear=pytestconfig.getoption("--dear"),
                times=pytestconfig.getoption("--times"),
                everything=pytestconfig.getoption("--all"),
                quick=quick,
                prune=update and {Path(m.__file__) for m in modules.values()} >= {*HERE.rglob("bench_*.py")},
                seed=pytestconfig.getoption("--seed"),
                progress=progress,
                cluster=Cluster(address) if address else None,
            )
        except InvalidInput as error:
            pytest.exit(str(error), returncode=2)
    pytestconfig.stash[OUTCOME] = outcome
    return outcome


@pytest.fixture
def measured_rows(outcome: run.Outcome) -> Callable[[str], list[dict]]:
    """Return a function: name of a table -> its rows measured by this run; it fails if any of its cells failed."""

    def rows(table: str) -> list[dict]:
        failed = outcome.failures(lambda cell: table in cell.tables)
        assert not failed, "cells that could not be measured:\n" + "\n".join(failed)
        return outcome.rows(table)

    return rows


@pytest.fixture
def complete(outcome: run.Outcome) -> Callable[[str], bool]:
    """Return a function: name of a table -> True if this run measured all rows of that table."""

    def is_complete(table: str) -> bool:
        members = [c for c in outcome.cells if table in c.tables]
        return bool(members) and all(c.id in outcome.entries for c in members)

    return is_complete


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the reports; an error while writing a page fails the run."""
    config = session.config
    if OUTCOME not in config.stash:
        return
    from phasebench.benchmarks import report

    try:
        with screen.progress(sys.stderr) as progress:
            entry = report.build(
                _folder(config), quick=config.getoption("--quick"), progress=lambda k, n: progress("pages", k, n, 0.0)
            )
        config.stash[NOTES].append(f"read {entry}")
    except Exception:
        config.stash[NOTES].append(f"the reports could not be written:\n{traceback.format_exc()}")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, exitstatus: int | pytest.ExitCode, config: pytest.Config
) -> None:
    """Print a table of what this run measured; after an interrupt, say that the same command continues the run."""
    if exitstatus == pytest.ExitCode.INTERRUPTED:
        terminalreporter.write_line("stopped: what was measured is kept, and the same command goes on from there")
    if OUTCOME not in config.stash:
        return
    outcome = config.stash[OUTCOME]
    terminalreporter.section("measured")
    for line in (*screen.summary(outcome).splitlines(), *outcome.notes, *config.stash[NOTES]):
        terminalreporter.write_line(line)
