"""The data of the site's page "Which integrator should I use?": an answer names a run that a command makes again."""

from __future__ import annotations

import numpy as np
import pandas as pd
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


def runs(**seconds: float) -> list[pd.DataFrame]:
    """Fabricated runs of integrators, name -> seconds, on one scene with an error of 1e-7."""
    names = {"rk4": "rk4", "loop": "scipy-ode(DOP853)", "mode": "heyoka(compact_mode=False)"}
    at = {"scene": "a", "problem": "pendulum", "quantity": "end-state", "t_end": 10.0, "error": 1e-7, "steps": 100.0}
    rows = [at | {"integrator": names[k], "seconds": s, "tol": np.nan, "accuracy": np.nan} for k, s in seconds.items()]
    return [pd.DataFrame(rows)]


def test_an_integrator_without_a_command_is_a_rival_alone(chooser):
    answer = chooser.choose(runs(rk4=2e-5, loop=1e-5, mode=3e-5), 1e-6, "")
    assert (answer["integrator"], answer["rival"], answer["ratio"]) == ("rk4", "scipy-ode(DOP853)", "2")
    assert answer["command"] == "phasebench integrate pendulum rk4 --steps 100 --t-end 10.0 --error"
    assert chooser.choose(runs(loop=1e-5, mode=3e-5), 1e-6, "") is None
    assert chooser.choose(runs(rk4=2e-5), 1e-8, "") is None
    assert chooser.choose(runs(rk4=2e-5), 1e-6, "symplectic") is None
