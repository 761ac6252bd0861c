"""Where a run ends early does not depend on which rows are stored."""

from __future__ import annotations

import pytest

from support import stops


@pytest.fixture(scope="module")
def results_of(of_each):
    """Function: label of a method -> its results from `support.stops.of`, runs that end early."""
    return of_each(stops)


@pytest.mark.parametrize("label", stops.ALL)
def test_a_run_ends_alike_for_any_spacing_of_rows(results_of, label):
    found = results_of(label)
    every_step, every_fifth, ends = (found[every] for every in ("1", "5", "0"))
    status, reached, evaluations, states = every_step
    assert {status} == {every_fifth[0], ends[0]}
    whole = status in ("ok", "inaccurate", "unstable", "no-root")  # a step without a root does not end a run
    assert whole == (reached == stops.STEPS)
    assert every_fifth[1] == (reached if whole else 5 * (reached // 5))
    assert ends[1] == (reached if whole else 0)
    for _, steps, _, rows in (every_fifth, ends):
        assert rows[-1] == states[steps], "a row is the state after so many steps"
    if status != "diverged":  # an overflow is noticed only at a stored row
        assert {evaluations} == {every_fifth[2], ends[2]}


def test_every_kind_of_end_occurs(results_of):
    kinds = {results_of(label)["1"][0] for label in stops.ALL}
    assert kinds >= {"ok", "unstable", "diverged", "not-converged"}
