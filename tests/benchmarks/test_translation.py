"""Equations written for heyoka by hand are those of the problems, and hardly fewer series than the suite's."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.costs import peers
from phasebench.reference.peers import heyoka_forms

hy = pytest.importorskip("heyoka")
SIDES = importlib.import_module("phasebench.benchmarks.studies.costs.by_hand").SIDES

#: Problem -> the suite's number of series over that of the equations by hand, at most.
MOST = dict.fromkeys(SIDES, 1.15) | {"kerr": 1.4}


def by_hand(made):
    return next(motion for name, motion, _ in peers.equations(made) if name == "by hand")


def series(motion):
    """The number of Taylor series that heyoka computes for equations."""
    ta = hy.taylor_adaptive(motion, np.ones(len(motion)), tol=0.1, compact_mode=True)
    return len(ta.decomposition) - 2 * len(motion)


@pytest.mark.parametrize("name", SIDES)
def test_equations_by_hand(name):
    made = problem(name)
    y = np.array([*made.q0, *made.p0]) * (1 + np.arange(1, 2 * made.system.d + 1) / 64) + 1 / 128
    right = made.system.rates(y[None, : made.system.d], y[None, made.system.d :])[:, 0]
    motion = by_hand(made)
    found = hy.cfunc([side for _, side in motion], [x for x, _ in motion])(y)
    assert np.abs(found - right).max() < 1e-12 * np.abs(right).max()
    moved = hy.cfunc([side for _, side in motion], [x for x, _ in motion])(y + 1e-9)
    assert np.abs(moved - right).max() > 1e-12 * np.abs(right).max()
    ours = heyoka_forms.form(made.system, heyoka_forms.TRANSLATED)
    assert series(list(ours.equations)) <= MOST[name] * series(motion)
