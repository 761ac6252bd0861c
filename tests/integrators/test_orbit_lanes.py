"""Orbits in SIMD lanes: blocks of orbits, the kernel called for each block, supported systems and methods."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from numba import types

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile import codegen
from phasebench.integrators.registry import BY_ID, method
from phasebench.integrators.stepping import orbit_lanes
from phasebench.integrators.stepping.kernel import COUNTS, LINE, Prepared, Samples, numbers
from phasebench.integrators.stepping.solve import LEVELS
from phasebench.integrators.values import vector
from phasebench.integrators.values.lane_memory import block_type, table_type, type_with_block
from phasebench.integrators.values.lanes import Lanes
from phasebench.integrators.values.masks import LANES
from support.marks import compiled

W = LANES.n
DOUBLE = types.float64


# -- blocks -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, W - 1, W, W + 1, 3 * W])
@pytest.mark.parametrize("shape", [(), (2,), (2, 3)])
def test_orbits_are_packed_into_blocks(n, shape):
    """Orbit i is lane i % W of block i // W; unused lanes are padded."""
    rows = np.random.default_rng(n).normal(size=(n, *shape))
    blocks = orbit_lanes.to_blocks(rows, 7.0)
    assert blocks.shape == (-(-n // W), *shape, W)
    assert blocks.flags.c_contiguous
    for i in range(n):
        np.testing.assert_array_equal(blocks[i // W, ..., i % W], rows[i])
    assert (blocks == 7).sum() == (len(blocks) * W - n) * np.prod(shape, initial=1.0)
    if shape:
        np.testing.assert_array_equal(orbit_lanes.from_blocks(blocks, n), rows)
    assert np.isnan(orbit_lanes.to_blocks(rows)).sum() == (blocks == 7).sum()


def test_padding_of_steps_and_weights():
    h, mu = np.array([0.1, 0.2]), np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    steps = orbit_lanes.varying_of(h, {})
    assert isinstance(steps, orbit_lanes.OfSteps)
    assert steps.h.tolist() == [[0.1, 0.2, *[1.0] * (W - 2)]]
    both = orbit_lanes.varying_of(h, {"mu": mu, "lam": 10 * mu})
    assert isinstance(both, orbit_lanes.OfWeights)
    assert both.h.tolist() == steps.h.tolist()
    assert both.mu.shape == both.lam.shape == (1, 3, W)
    assert both.mu[0, 2].tolist() == [3.0, 6.0, *[0.0] * (W - 2)]
    assert both.lam[0, 0].tolist() == [10.0, 40.0, *[0.0] * (W - 2)]


@pytest.mark.parametrize(("d", "stages", "width"), [(1, 0, 1), (3, 2, 6)])
def test_tables_hold_starts_and_stage_memory(d, stages, width):
    Q, P = np.random.default_rng(d).normal(size=(2, W + 1, d))
    prepared = SimpleNamespace(stages=stages, width=width)
    state, memory, work = orbit_lanes.tables_of(prepared, Q, P)
    assert not any(held.ctypes.data % LINE for held in (state, memory) if held.size)
    assert state.shape == (2, 4 + stages, max(2, d), W)
    np.testing.assert_array_equal(orbit_lanes.from_blocks(state[:, 0, :d], W + 1), Q)
    np.testing.assert_array_equal(orbit_lanes.from_blocks(state[:, 1, :d], W + 1), P)
    assert np.isnan(state[1, :2, :d, 1:]).all()
    assert not state[:, 2:].any()
    assert not state[:, :2, d:].any()
    assert memory.shape == (2, (3 * LEVELS + 1) * stages, width, W)
    assert work.shape == (2, 1, 1, W)
    assert not memory.any()
    assert not work.any()


# -- support ----------------------------------------------------------------------------------------------------------

SMALL = Hamiltonian(q="x y", p="u v", H="u**2/2 + v**2/2 + x**2*y**2 + x**2 + y**2")


@compiled
@pytest.mark.parametrize(
    ("id", "expected"),
    [
        ("stormer-verlet", True),
        ("scheme-i", True),
        ("rk4", True),
        ("gauss-2", False),
        ("avf", False),
        ("sofroniou-spaletta-10-adaptive", True),
        ("gauss-4-adaptive", False),
    ],
)
def test_methods_with_kernels_for_lanes(id, expected):
    assert orbit_lanes.runs_in_lanes(SMALL, method(id)) == expected


@compiled
def test_large_and_hand_written_systems_are_not_supported():
    for d, expected in ((orbit_lanes.MOST, True), (orbit_lanes.MOST + 1, False)):
        q, p = ([f"{x}{i}" for i in range(d)] for x in "qp")
        H = " + ".join(f"{x}**2/2" for x in (*q, *p))
        assert orbit_lanes.runs_in_lanes(Hamiltonian(q=q, p=p, H=H), method("stormer-verlet")) == expected
    for system, expected in (
        (SimpleNamespace(make_function=None, loops={}), True),
        (SimpleNamespace(make_function=None, loops={"field": 1}), False),
        (SimpleNamespace(loops={}), False),
    ):
        assert orbit_lanes.compiles_in_lanes(system) == expected


def test_without_compilation_there_are_no_lanes(monkeypatch):
    monkeypatch.setattr(codegen, "compiled", lambda: False)
    assert not orbit_lanes.compiles_in_lanes(SMALL)
    assert not orbit_lanes.runs_in_lanes(SMALL, BY_ID["stormer-verlet"])


def test_the_lane_version_of_a_system_is_made_once():
    system = problem("pendulum").system
    twin = orbit_lanes.twin(system)
    assert orbit_lanes.twin(system) is twin is orbit_lanes.twin(system, LANES)
    assert twin is not system
    assert twin.variant == f"{W} lanes"
    assert getattr(system, "variant", None) != twin.variant
    other = orbit_lanes.twin(system, Lanes(2 * W))
    assert (other.variant, other is not twin) == (f"{2 * W} lanes", True)


# -- types ------------------------------------------------------------------------------------------------------------


def test_lane_types_replace_numbers():
    lanes = Lanes(4)
    put = orbit_lanes._lanes_for_numbers
    assert put(DOUBLE, lanes) == lanes
    assert put(types.UniTuple(DOUBLE, 3), lanes) == types.UniTuple(lanes, 3)
    assert put(types.Tuple((DOUBLE, types.int64, types.UniTuple(DOUBLE, 1))), lanes) == types.Tuple(
        (lanes, types.int64, types.UniTuple(lanes, 1))
    )
    assert put(types.int64, lanes) == types.int64


def test_the_type_of_a_block():
    for ndim in (3, 4):
        kind = block_type(types.Array(DOUBLE, ndim, "C"))
        assert (kind.dtype, kind.ndim, kind.layout, kind.aligned) == (LANES, ndim - 2, "C", False)
    assert block_type(types.Array(DOUBLE, 2, "C")) is LANES
    assert table_type().ndim == 2


class Step(NamedTuple):
    """The step of a toy method with coefficients c and step size h."""

    c: np.ndarray
    h: float = 0.0


def test_fields_that_differ_between_orbits_are_lanes():
    kinds = [types.Array(DOUBLE, 1, "C", readonly=True), DOUBLE]
    record = types.BaseTuple.from_types(tuple(kinds), Step)
    given = types.BaseTuple.from_types((types.Array(DOUBLE, 2, "C"),), orbit_lanes.OfSteps)
    made = type_with_block(record, given)
    assert made.types == (kinds[0], LANES)
    assert made.instance_class is Step


# -- the loop ---------------------------------------------------------------------------------------------------------


def run(step, orbit, samples, counts):
    """Toy kernel: q grows by h c_0 p per step; the parameter of a row is h; the memory counts rows."""
    y = vector.read_state(orbit)
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            y = vector.State(vector.axpy(step.h * step.c[0], y.p, y.q), y.p, y.lost_q, y.lost_p)
            counts.steps += 1
        vector.write_sample(samples, row, y)
        samples.parameter[row, 0] = step.h
        orbit.memory[1, 0] = orbit.memory[1, 0] + 1.0
    vector.write_state(orbit, y)
    return len(samples.q), 0


@compiled
@pytest.mark.processor
def test_a_kernel_is_called_for_every_block():
    d, n, rows, every = 3, 2 * W + 1, 2, 5
    prepared = Prepared(run, Step(numbers([0.5], "double")), width=1, stages=1)
    Q, P = np.random.default_rng(0).normal(size=(2, n, d))
    h = np.linspace(0.1, 0.9, n)
    varying, tables = orbit_lanes.varying_of(h, {}), orbit_lanes.tables_of(prepared, Q, P)
    loop = orbit_lanes.loop(prepared, orbit_lanes.varying_of(np.ones(1), {}), d)
    q, p = (np.full((3, rows, d, W), np.nan) for _ in "qp")
    samples = Samples(q, p, np.zeros((3, rows, 1, W)), every)
    counts = np.zeros(3, COUNTS)
    loop(prepared.step, varying, tables, (0.0,) * d, samples, counts)
    for row in range(rows):
        wanted = Q + 0.5 * h[:, None] * (row + 1) * every * P
        np.testing.assert_allclose(orbit_lanes.from_blocks(q[:, row], n), wanted, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(orbit_lanes.from_blocks(p[:, row], n), P)
        np.testing.assert_array_equal(orbit_lanes.from_blocks(samples.parameter[:, row], n)[:, 0], h)
    np.testing.assert_array_equal(tables.state[:, 0, :d], q[:, -1])
    assert counts["steps"].tolist() == [rows * every] * 3
    assert (tables.memory[:, 1] == rows).all()
    assert not tables.memory[:, [0, *range(2, tables.memory.shape[1])]].any()
    again = orbit_lanes.loop(prepared, varying, d)
    before = len(orbit_lanes._loops)
    again(prepared.step, varying, tables, (0.0,) * d, samples, counts)
    assert len(orbit_lanes._loops) == before
    assert counts["steps"].tolist() == [2 * rows * every] * 3
