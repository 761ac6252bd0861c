"""What is advised was run and meets what was asked when run again; what is kept of the trade's rows is re-recorded."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.advice import prior
from phasebench.benchmarks.certificate import fronts, times
from phasebench.benchmarks.experiments.advice.cells import TABLE, cells  # noqa: F401
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS

#: The trade's runs, from which the prior is made, and who is the cheapest.
RUNS, CHOICES = "front_rungs", "front"


def unmet(rows) -> list[str]:
    """The asks whose advice does not meet the accuracy when it is run again."""
    return [f"{r['ask']}: {r['command']}: {r['rerun error']}" for r in rows if r["command"] and not r["met"]]


def bench_advice(measured):
    """Every advised command meets its accuracy, run again by a process of its own."""
    rows = measured(TABLE)
    assert not unmet(rows), "\n".join(unmet(rows))


def bench_verified(measured):
    """What is advised was verified, and what is not advised says why."""
    wrong = [r["ask"] for r in measured(TABLE) if not (r["verified"] if r["command"] else r["why"])]
    assert not wrong, wrong


def prior_of(rows) -> list[dict]:
    """The lines of the prior from the trade's rows, of who can be asked for by name and carries one orbit at a time."""
    named = {x.id for x in (*METHODS, *PEERS)} - {"heyoka-batch"}
    frame = pd.DataFrame([r for r in rows if r.get("status") == OK and r["id"] in named])
    problems = frame["scene"].map(lambda scene: BY_ID[scene].problem.partition(":")[0])
    return prior.made(frame.assign(problem=problems))


def bench_prior(outcome, complete, update):
    """The prior and the certificate's fronts are re-recorded with the tables where the whole trade was measured."""
    if not update or not complete(RUNS):
        pytest.skip("the prior is made with --update-tables where all of the trade is measured")
    prior.keep(prior_of(outcome.rows(RUNS)))
    fronts.keep(fronts.made(outcome.rows(RUNS)))
    times.keep(times.made(outcome.rows(CHOICES), outcome.rows(RUNS)))
