r"""States stored as arrays (d above `codegen.TUPLE_LIMIT`) reach the same end states as tuples and NumPy loops.

The system is the chain of Fermi, Pasta, Ulam (Los Alamos LA-1940, 1955) with fixed ends, :math:`H = \tfrac12|p|^2 +
\sum_{i=0}^{d} \bigl(\tfrac12 r_i^2 + \tfrac\alpha3 r_i^3 + \tfrac\beta4 r_i^4\bigr)`, :math:`r_i = q_{i+1} - q_i`,
integrated here once more by NumPy loops.
"""

from __future__ import annotations

import numba
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput, integrate
from phasebench.integrators.compile import codegen
from phasebench.integrators.values.vector import (
    add,
    add_product,
    add_product_in_place,
    axpy,
    bump,
    head,
    join,
    load,
    minus,
    plus,
    scale,
    store,
    tail,
)
from support.kinds import arrays_and_tuples_apart
from support.solutions import end

ALPHA, BETA = sp.Rational(1, 4), sp.Rational(1, 2)
D = codegen.TUPLE_LIMIT + 1
H, STEPS = 0.1, 60
ROUND_OFF = 1e-12


@pytest.fixture(scope="module")
def chain() -> Hamiltonian:
    """The Fermi-Pasta-Ulam chain of D particles as a system."""
    q, p = sp.symbols(f"q:{D}", real=True), sp.symbols(f"p:{D}", real=True)
    r = [b - a for a, b in zip((0, *q), (*q, 0), strict=True)]
    V = sum(x**2 / 2 + ALPHA * x**3 / 3 + BETA * x**4 / 4 for x in r)
    return Hamiltonian(q=q, p=p, H=sum(x**2 for x in p) / 2 + V)


Q0 = np.sin(np.pi * np.arange(1, D + 1) / (D + 1)) + 0.3 * np.cos(1.7 * np.arange(D))
P0 = 0.5 * np.sin(2.3 * np.arange(D) + 0.4)


def force(q):
    """-dV/dq of the chain, array (d,)."""
    r = np.diff(np.concatenate([[0.0], q, [0.0]]))
    tension = r + float(ALPHA) * r**2 + float(BETA) * r**3
    return tension[1:] - tension[:-1]


def energy(q, p):
    """H of the chain at (q, p), by NumPy."""
    r = np.diff(np.concatenate([[0.0], q, [0.0]]))
    return p @ p / 2 + (r**2 / 2 + float(ALPHA) * r**3 / 3 + float(BETA) * r**4 / 4).sum()


def field(y):
    """(q', p') at y = (q, p), array (2 d,)."""
    return np.concatenate([y[D:], force(y[:D])])


def verlet(y):
    """One Stormer-Verlet step of y = (q, p)."""
    q, p = y[:D], y[D:]
    p = p + H / 2 * force(q)
    q = q + H * p
    return np.concatenate([q, p + H / 2 * force(q)])


def rk4(y):
    """One step of the classical Runge-Kutta method."""
    a = field(y)
    b = field(y + H / 2 * a)
    c = field(y + H / 2 * b)
    return y + H / 6 * (a + 2 * b + 2 * c + field(y + H * c))


def fixed_point(mean):
    """Step function of y1 = y + h mean(y, y1), solved by fixed-point iteration."""

    def step(y):
        new = y
        for _ in range(200):
            last, new = new, y + H * mean(y, new)
            if np.abs(new - last).max() < 1e-16:
                break
        return new

    return step


def average_field(y, new):
    """Average of the field between y and new by Simpson's rule, which is exact for its cubic components."""
    return (field(y) + 4 * field((y + new) / 2) + field(new)) / 6


LOOPS = {
    "stormer-verlet": verlet,
    "rk4": rk4,
    "implicit-midpoint": fixed_point(lambda y, new: field((y + new) / 2)),
    "avf": fixed_point(average_field),
}


@pytest.mark.parametrize("id", LOOPS)
def test_the_chain_agrees_with_numpy_loops(chain, id):
    y = np.concatenate([Q0, P0])
    for _ in range(STEPS):
        y = LOOPS[id](y)
    found = end(integrate(chain, id, h=H, steps=STEPS, q0=Q0, p0=P0))
    assert np.abs(found - y).max() < ROUND_OFF


def test_control_the_loops_differ():
    ends = []
    for step in LOOPS.values():
        y = np.concatenate([Q0, P0])
        for _ in range(STEPS):
            y = step(y)
        ends.append(y)
    for i, a in enumerate(ends):
        assert all(np.abs(a - b).max() > 1e6 * ROUND_OFF for b in ends[:i])


def test_avf_conserves_the_energy_of_the_chain(chain):
    done = {id: integrate(chain, id, h=H, steps=400, q0=Q0, p0=P0) for id in ("avf", "implicit-midpoint")}
    error = {
        id: max(abs(energy(q, p) - energy(Q0, P0)) for q, p in zip(s.q, s.p, strict=True)) for id, s in done.items()
    }
    assert error["avf"] < 1e-13 * 400**0.5 * energy(Q0, P0)
    assert error["implicit-midpoint"] > 1e-6


def test_the_energy_equals_its_formula(chain):
    assert chain.observe(chain.H, Q0[None], P0[None])[0] == pytest.approx(energy(Q0, P0), rel=1e-14)


def test_array_kernels_raise_invalid_input():
    """For h omega = pi a coefficient of Gautschi's method is infinite; a kernel for arrays raises InvalidInput too."""
    d = codegen.TUPLE_LIMIT + 1
    q, p = ([f"{x}{i}" for i in range(d)] for x in "qp")
    H = " + ".join(f"{x}**2/2" for x in (*p, *q)) + " + q0**4/4"
    system = Hamiltonian(q=q, p=p, H=H, frequencies=[1] * d)
    with pytest.raises(InvalidInput, match=r"is 1\.0 pi"):
        integrate(system, "gautschi", h=np.pi, steps=1, q0=np.ones(d), p0=np.ones(d))


SMALL = [
    "explicit-euler",
    "dop853",  # sums over stages whose weights differ
    "symplectic-euler-q",
    "implicit-midpoint",
    "scheme-i",
    "scheme-ii",
    "avf",
]


@pytest.mark.parametrize("id", SMALL)
def test_arrays_and_tuples_agree(id):
    assert arrays_and_tuples_apart(id) < ROUND_OFF


def test_overflow_on_arrays_is_a_divergence(chain):
    found = integrate(chain, "explicit-euler", h=2.0, steps=200, q0=Q0, p0=P0)
    assert found.status == "diverged"
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize("n", [31, 2 * codegen.TUPLE_LIMIT])
def test_operations_compile_on_the_longest_tuples(n):
    """(q, p) is one tuple of up to twice the limit; Python builds tuples of more than 30 items differently."""

    @numba.njit
    def operate(x, y, A):
        store(A, 0, bump(axpy(0.5, x, y), n - 1, 1.0))
        s, c = add(load(A, 0, x), scale(0.0, x), minus(y, x))
        return plus(s, join(head(c), tail(c)))

    x, y = np.arange(1.0, n + 1), np.sqrt(np.arange(1.0, n + 1))
    expected = 2 * y - 0.5 * x
    expected[-1] += 1.0
    assert np.abs(np.array(operate(tuple(x), tuple(y), np.zeros((1, n)))) - expected).max() < 1e-13


def test_the_in_place_sum_is_the_compensated_sum():
    """Its result overwrites both of its first arguments."""

    @numba.njit
    def new(x, c, v):
        return add_product(x, c, 0.3, v)

    @numba.njit
    def same_place(x, c, v):
        return add_product_in_place(x, c, 0.3, v)

    x, v = np.random.default_rng(8).normal(size=(2, D))
    wanted = x, np.zeros(D)
    found = tuple(row.copy() for row in wanted)
    for _ in range(5):
        wanted, ends = new(*wanted, v), same_place(*found, v)
        assert all((a == b).all() and (a == c).all() for a, b, c in zip(wanted, found, ends, strict=True))
    assert (found[1] != 0).any(), "the control: rounding lost something"


def test_a_lost_close_encounter_is_a_collision():
    """Eight bodies defined by loops, whose least distance is a function of the rows."""
    made = problem("n-body", N=8)
    q = 3 * np.array(made.q0).reshape(8, 3)
    q[0], q[1] = (10.0, 0.0, 0.0), (10.5, 0.0, 0.0)
    start = {"q0": q.ravel(), "p0": np.zeros(24)}
    lost = integrate(made, "stormer-verlet", h=0.01, t_end=3.0, **start)
    assert lost.status == "collision"
    assert "take a smaller h" in lost.reason
    assert integrate(made, "stormer-verlet", h=0.01, t_end=0.3, **start).status == "ok"
