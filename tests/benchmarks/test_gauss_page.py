"""The page of Gauss' method of order 16 beside explicit methods: where they cross, and verdicts either way."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.trade import gauss_page
from phasebench.benchmarks.experiments.trade.front import RUNGS
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count


def data(*scenes):
    """Data of the page: for each (scene, exponent, constant) times of Gauss and of two explicit methods.

    The explicit methods take the time 1 / error^exponent, Gauss ``constant`` at every error.
    """
    rows = []
    for scene, exponent, constant in scenes:
        for k in range(1, 11):
            error = 0.9 * 10.0**-k
            times = {"gauss-8": constant, "pefrl": error**-exponent, "rk4": 2 * error**-exponent, "heyoka": 1e-9}
            rows += [
                {"scene": scene, "integrator": id, "id": id, "status": "ok", "error": error, "seconds": seconds}
                for id, seconds in times.items()
            ]
    return {RUNGS: pd.DataFrame(rows)}.get


def test_methods_cross_where_their_times_do():
    found = gauss_page.crossings(data(("toda", 0.25, 100.0), ("duffing", 0.25, 1e9))(RUNGS))
    assert found["toda"] == pytest.approx(1e-8)  # (0.9e-8)^-1/4 = 102.7, and (0.9e-7)^-1/4 = 57.7
    assert np.isnan(found["duffing"])


def test_only_the_end_of_a_scene_counts():
    """An error at which Gauss is faster by chance, before larger ratios at smaller errors, is no crossing."""
    part = pd.DataFrame({"accuracy": [1e-1, 1e-2, 1e-3, 1e-4], "ratio": [0.9, 1.2, 0.8, 0.7]})
    assert gauss_page.crossing(part) == 1e-3
    assert np.isnan(gauss_page.crossing(part.assign(ratio=[0.5, 0.5, 0.5, 1.5])))


def test_peers_and_runs_that_failed_do_not_count():
    given = data(("toda", 0.25, 100.0))(RUNGS)
    assert set(gauss_page.ratios(given)["fastest explicit"]) == {"pefrl"}
    failed = given.assign(status=given["status"].mask(given["id"] == "pefrl", "diverged"))
    assert set(gauss_page.ratios(failed)["fastest explicit"]) == {"rk4"}


def test_a_scene_ends_where_only_the_first_of_the_search_are_left():
    given = data(("toda", 0.25, 100.0))(RUNGS)
    given.loc[given["id"] == "rk4", "seconds"] /= 4
    dropped = given[(given["id"] != "rk4") | (given["error"] > 1e-6)]
    assert gauss_page.ratios(given)["accuracy"].min() == pytest.approx(1e-10)
    assert gauss_page.ratios(dropped)["accuracy"].min() == pytest.approx(1e-5)


def test_what_is_explicit_depends_on_the_system():
    assert gauss_page.is_explicit("pefrl", True)
    assert not gauss_page.is_explicit("pefrl", False)
    assert gauss_page.is_explicit("rk4", False)
    for id in ("scheme-iii", "gauss-8", "rk4-adaptive", "heyoka"):
        assert not gauss_page.is_explicit(id, True), id


def test_verdicts_pass_and_find():
    given = data(("toda", 0.25, 100.0))
    fine, coarse = (v(given) for v in gauss_page.PAGE.verdicts)
    assert (fine.outcome, fine.measured) == (coarse.outcome, coarse.measured) == (PASS, Count(1, 1))
    slow = gauss_page.fine(data(("toda", 0.25, 100.0), ("duffing", 0.25, 1e9)))
    assert (slow.outcome, slow.measured) == (FINDING, Count(1, 2))
    assert slow.where.startswith("duffing: ")
    fast = gauss_page.coarse(data(("toda", 0.25, 1e-3)))
    assert (fast.outcome, fast.where) == (FINDING, "toda: 5.48e-04 times")


def test_answer_names_the_error():
    told = gauss_page.answer(data(("toda", 0.25, 100.0), (gauss_page.PLANETS, 0.25, 1000.0)))
    assert told.startswith("On 1 of 2 scenes")
    assert "1e-08" in told
    assert gauss_page.answer(data(("toda", 0.25, 1e9))).startswith("On none of 1 scenes")


def test_table_has_a_row_per_scene():
    frame = gauss_page.table(data(("toda", 0.25, 100.0), ("duffing", 0.25, 1e9))).frame
    assert list(frame["faster from"]) == ["1e-08", "nowhere"]
