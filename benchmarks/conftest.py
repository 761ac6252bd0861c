"""`pytest benchmarks`: measure, compare with the stored tables, write the reports."""

from __future__ import annotations

from pathlib import Path

import pytest

from phasebench.benchmarks.rows.tables import Results

ROOT = Path(__file__).resolve().parents[1]


def pytest_addoption(parser):
    """The options of the main job."""
    group = parser.getgroup("phasebench")
    group.addoption("--quick", action="store_true", help="fewer steps and rounds, reports to reports/quick")
    group.addoption("--update-tables", action="store_true", help="re-record reference/tables and show what changed")
    group.addoption("--reports", default=None, help="where the reports go (default: reports, or reports/quick)")


def pytest_configure(config):
    """Where this run's results go."""
    quick = config.getoption("--quick")
    folder = config.getoption("--reports") or ROOT / "reports" / ("quick" if quick else "")
    config.stash[RESULTS] = Results(Path(folder), quick)


RESULTS = pytest.StashKey[Results]()


@pytest.fixture(scope="session")
def results(pytestconfig) -> Results:
    """What the run measured, by name; written when it ends."""
    return pytestconfig.stash[RESULTS]


@pytest.fixture(scope="session")
def quick(pytestconfig) -> bool:
    """Whether this is the quick tier."""
    return pytestconfig.getoption("--quick")


@pytest.fixture(scope="session")
def update(pytestconfig) -> bool:
    """Whether the stored tables are re-recorded."""
    return pytestconfig.getoption("--update-tables")


def pytest_terminal_summary(terminalreporter, exitstatus, config):
    """Write the data and the reports, and say where."""
    results = config.stash[RESULTS]
    if not results.measured:
        return
    terminalreporter.section("reports")
    results.write()
    from phasebench.benchmarks import report

    entry = report.build(results.folder, quick=results.quick, progress=terminalreporter.write_line)
    for line in results.notes:
        terminalreporter.write_line(line)
    terminalreporter.write_line(f"read {entry}")
