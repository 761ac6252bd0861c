"""The data of the site's page "Which integrator should I use?": an answer names a run that a command makes again."""

from __future__ import annotations

import pytest

from phasebench.integrators.compile import digest as sources
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers import BY_ID as PEERS


@pytest.fixture(scope="module")
def chooser():
    """The module of the site that makes the page's data."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(sources.ROOT / "docs" / "_ext")
        import chooser

        yield chooser


def test_command_of_every_answer_names_its_problem_and_a_registered_integrator(chooser):
    found = chooser.answers()
    assert {row["class"] for row in found} <= {*chooser.CLASSES}
    assert len(found) > 100
    for row in found:
        program, command, problem, id = row["command"].split()[:4]
        assert (program, command, problem) == ("phasebench", "integrate", row["problem"])
        assert id in BY_ID if row["own"] else id in PEERS, row
