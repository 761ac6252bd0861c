"""Where a run ends on the way does not depend on the rows that are kept: what fails in a row is not stepped over."""

from __future__ import annotations

import pytest

from support import stops


@pytest.fixture(scope="module")
def ended(of_each):
    return of_each(stops)


@pytest.mark.parametrize("label", stops.ALL)
def test_a_run_ends_alike_whichever_rows_are_kept(ended, label):
    found = ended(label)
    every_step, every_fifth, ends = (found[every] for every in ("1", "5", "0"))
    status, reached, evaluations, states = every_step
    assert {status} == {every_fifth[0], ends[0]}
    whole = status in ("ok", "inaccurate", "unstable", "no-root")  # a step without a root is taken all the same
    assert whole == (reached == stops.STEPS)
    assert every_fifth[1] == (reached if whole else 5 * (reached // 5))
    assert ends[1] == (reached if whole else 0)
    for _, steps, _, rows in (every_fifth, ends):
        assert rows[-1] == states[steps], "a row is the state after so many steps"
    if status != "diverged":  # what overflows is seen when a row is looked at
        assert {evaluations} == {every_fifth[2], ends[2]}


def test_every_kind_of_end_is_among_them(ended):
    kinds = {ended(label)["1"][0] for label in stops.ALL}
    assert kinds >= {"ok", "unstable", "diverged", "not-converged"}
