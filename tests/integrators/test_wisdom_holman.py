"""Wisdom-Holman splittings: generalized orders, correctors, Jacobi coordinates, the planets.

``python test_wisdom_holman.py`` prints what a process with NUMBA_DISABLE_JIT=1 measures.
"""

from __future__ import annotations

import json
import sys
from fractions import Fraction
from math import log
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import driver
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import planet_lanes, planet_pairs, wisdom_holman
from phasebench.integrators.families.wisdom_holman import KeplerPart, corrector, jacobi
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping import kepler_flow, kepler_lanes
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.values import vector
from support.solutions import end

FAMILY = [m.id for m in METHODS if m.family == "wisdom_holman"]
#: Power of h in the error term of first order in the perturbation.
FIRST_ORDER = {
    "wisdom-holman": 2,
    "wisdom-holman-corrector(corrector=3)": 4,
    "wisdom-holman-corrector(corrector=5)": 6,
    "wisdom-holman-corrector(corrector=7)": 8,
    "wisdom-holman-corrector(corrector=11)": 12,
    "wisdom-holman-corrector(corrector=17)": 18,
    "wisdom-holman-saba-2": 4,
    "wisdom-holman-saba-4": 8,
    "wisdom-holman-aba-8-6-4": 8,
    "wisdom-holman-aba-10-6-4": 10,
}
#: A perturbation whose square is negligible, and the digits needed for it.
TINY, DIGITS = 1e-30, 80
#: Problem and step whose states are compared with plain NumPy.
PLANETS, H = "outer-solar-system", 100.0


def by_label(label):
    """The method of a label such as "id" or "id(corrector=n)"."""
    id, _, value = label.partition("(corrector=")
    return method(id, corrector=int(value[:-1])) if value else method(id)


def first_orders():
    """{method: observed orders of the part of its error that is of first order in the perturbation}.

    "wrong sign" is the control.
    """
    from phasebench.benchmarks.measure.multiprecision import advance, flow

    out = {}
    with precision(DIGITS):
        made = problem("perturbed-kepler", e=0.2, mu=TINY)
        y, _ = flow(made.system, [*made.q0, *made.p0], 0.5, 16)
        span = Fraction(1, 8)
        end, _ = flow(made.system, y, span, 32)

        def orders(chosen):
            errors = [max(abs(advance(made.system, chosen, y, span / n, n) - end)) for n in (2, 3, 4)]
            return [log(errors[i] / errors[i + 1]) / log((i + 3) / (i + 2)) for i in (0, 1)]

        for label in FIRST_ORDER:
            out[label] = orders(by_label(label))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(wisdom_holman, "corrector", lambda order: [(t, -b) for t, b in corrector(order)])
            out["wrong sign"] = orders(by_label("wisdom-holman-corrector(corrector=17)"))
    return out


def planets(ids=FAMILY):
    """{id: [states of the outer solar system in hexadecimal, counts]} of a run in two pieces."""
    return {id: _planets(id) for id in ids}


def _planets(id):
    """[states in hexadecimal, counts] of one method on the outer solar system, in two pieces."""
    made = problem(PLANETS)
    layout = lay_out(prepare(method(id), made.system), made.system.d, H, made.q0, made.p0)
    states = np.zeros((2, 2, made.system.d))
    for k, steps in enumerate((2, 1)):
        assert layout(*states[:, k : k + 1], np.zeros((1, 1)), steps) == (1, 0)
    return [[[x.hex() for x in rows.ravel().tolist()] for rows in states], [int(n) for n in layout.counts]]


def elsewhere(system, q, p, t):
    """State of a system at time t from (q, p), by SciPy's DOP853."""
    from scipy.integrate import solve_ivp

    return solve_ivp(system.vector_field(), (0, t), [*q, *p], method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]


@pytest.fixture(scope="module")
def observed(uncompiled):
    """The results of `first_orders`, measured without compilation."""
    return uncompiled("integrators/test_wisdom_holman.py", "orders")


@pytest.mark.parametrize("label", FIRST_ORDER)
def test_the_error_to_first_order_in_the_perturbation(observed, label):
    """The corrector of order n reduces eps h^2 to eps h^(n + 1): eps h^18 for n = 17."""
    assert observed[label] == pytest.approx([FIRST_ORDER[label]] * 2, abs=0.1)


def test_control_a_corrector_with_wrong_sign_is_useless(observed):
    assert observed["wrong sign"] == pytest.approx([2, 2], abs=0.1)


def test_correctors_equal_the_published_ones():
    """Wisdom (2006), table 1: alpha = sqrt(7/40), beta = 1/(48 alpha); beta/2 for order 3, 5/6 and 1/6 beta for 5."""
    alpha = mpmath.sqrt(mpmath.mpf(7) / 40)
    beta = 1 / (48 * alpha)
    found = {n: {float(round(t / alpha)): b / beta for t, b in corrector(n)} for n in (3, 5)}
    assert found[3][1] == pytest.approx(-1 / 2, rel=1e-15, abs=0)
    assert found[5][1] == pytest.approx(-5 / 6, rel=1e-15, abs=0)
    assert found[5][2] == pytest.approx(1 / 6, rel=1e-15, abs=0)
    for n in (3, 17):
        kicks = corrector(n)
        assert kicks == kicks[::-1], "backwards in time it is itself"
        pairs = [(float(t), float(b)) for t, b in kicks]
        assert sorted(pairs) == sorted((-t, -b) for t, b in pairs)


@pytest.mark.parametrize("value", [0, 2, 4, 9, 19, -3])
def test_other_correctors_are_refused(value):
    with pytest.raises(InvalidInput, match="3, 5, 7, 11, 17"):
        method("wisdom-holman-corrector", corrector=value)


@pytest.mark.parametrize("id", ["wisdom-holman", "wisdom-holman-corrector", "wisdom-holman-aba-8-6-4"])
@pytest.mark.parametrize(("name", "h"), [("perturbed-kepler", 0.1), (PLANETS, H)])
def test_states_do_not_depend_on_rows_or_pieces(id, name, h, monkeypatch):
    """States depend neither on which rows are stored nor on the pieces in which the driver calls the kernel."""
    made = problem(name)
    every = integrate(made, id, h=h, steps=100)
    some = integrate(made, id, h=h, steps=100, save_every=7)
    last = integrate(made, id, h=h, steps=100, save_every=0)
    monkeypatch.setattr(driver, "PIECE", 9)
    pieces = integrate(made, id, h=h, steps=100, save_every=11)
    assert np.array_equal(some.q[:-1], every.q[:-1:7])
    for other in (some, last, pieces):
        assert np.array_equal(end(other), end(every))


@pytest.mark.parametrize("id", FAMILY)
def test_kepler_is_solved_exactly(id):
    """Without an interaction every step is exact."""
    from phasebench.reference.solvers.exact import exact

    made = problem("kepler", e=0.6)
    Q, P = exact(made, [30.0])
    wanted = np.array([float(x) for x in (*Q[0], *P[0])])
    for steps in (10, 200):
        found = end(integrate(made, id, h=30.0 / steps, steps=steps))
        assert np.abs(found - wanted).max() < 1e-12
    other = end(integrate(problem("perturbed-kepler"), id, h=0.15, steps=200))
    assert np.abs(other - wanted).max() > 1e-3


def test_jacobi_coordinates_are_canonical():
    masses, G = [sp.Rational(m) for m in ("1", "1/1000", "3/1000")], sp.Rational(1, 3)
    part = jacobi(masses, G)
    C = part.matrix
    assert C * sp.Matrix([1, 1, 1]) == sp.Matrix([1, 0, 0]), "differences but for the centre of mass"
    assert C * sp.diag(*(1 / m for m in masses)) * C.T == sp.diag(*(1 / m for m in part.masses))
    assert part.mu == (0, G * sp.Rational(1001, 1000), G * sp.Rational(1004, 1000))
    assert part.masses[1] * part.mu[1] == G * masses[0] * masses[1]


def test_the_potential_of_two_bodies():
    part, q = jacobi([2, 3], 5, dimension=2), sp.symbols("x1 x2 y1 y2", real=True)
    r = sp.sqrt((q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2)
    assert sp.simplify(part.potential(q) + 2 * 3 * 5 / r) == 0


def planar(part):
    """A system of two bodies in the plane with this declared Kepler part."""
    q, p = sp.symbols("x1 x2 y1 y2", real=True), sp.symbols("u1 u2 v1 v2", real=True)
    r = sp.sqrt((q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2)
    H = (p[0] ** 2 + p[1] ** 2) / 2 + (p[2] ** 2 + p[3] ** 2) / sp.Rational(1, 2) - 1 / (4 * r)
    return Hamiltonian(q=q, p=p, H=H, singular=[r], kepler=part)


def test_two_bodies_in_the_plane_are_solved_exactly():
    """The centre of mass moves freely and the relative motion is Kepler's, so one long step equals many short ones."""
    system = planar(jacobi([1, sp.Rational(1, 4)], 1, dimension=2))
    state = {"q0": [0.1, 0.2, 1.0, 0.1], "p0": [0.3, -0.1, 0.05, 0.25]}
    one, many = (end(integrate(system, "wisdom-holman", h=7.0 / n, steps=n, **state)) for n in (1, 64))
    assert np.abs(one - many).max() < 1e-13
    assert np.abs(one - elsewhere(system, state["q0"], state["p0"], 7.0)).max() < 1e-10
    assert system.kepler.interaction(system)((0.1, 0.2, 1.0, 0.1)) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    "part",
    [
        KeplerPart(2, (1, 1), (0, 1)),
        KeplerPart(2, (1, sp.Rational(1, 2)), (1, 1)),
        KeplerPart(3, (1,), (1,)),
        jacobi([1, 2], 1, dimension=2),
    ],
)
def test_a_kepler_part_must_match_the_kinetic_energy(part):
    with pytest.raises(InvalidInput, match="Kepler part"):
        integrate(planar(part), "wisdom-holman", h=0.1, steps=1, q0=[0, 0, 1, 0], p0=[0, 0, 0, 1])


def test_systems_without_a_kepler_part_are_refused():
    with pytest.raises(InvalidInput, match="Kepler part"):
        integrate(problem("henon-heiles"), "wisdom-holman", h=0.1, steps=1)


def test_arrays_and_tuples_agree(monkeypatch):
    made = problem("perturbed-kepler")
    tuples = end(integrate(made, "wisdom-holman-corrector", h=0.05, steps=50))
    S = made.system
    with monkeypatch.context() as patch:
        patch.setattr(codegen, "TUPLE_LIMIT", 1)
        system = Hamiltonian(q=S.q, p=S.p, H=S.H, kepler=S.kepler)
        arrays = end(integrate(system, "wisdom-holman-corrector", h=0.05, steps=50, q0=made.q0, p0=made.p0))
    assert np.abs(arrays - tuples).max() < 1e-12


def small(masses, extra=0):
    """Bodies with these masses in space, G = 1, and an additional potential extra * q_1."""
    n = len(masses)
    q, p = sp.symbols(f"q:{3 * n}", real=True), sp.symbols(f"p:{3 * n}", real=True)
    pairs = [(i, j) for j in range(n) for i in range(j)]
    r = [sp.sqrt(sum((q[3 * j + k] - q[3 * i + k]) ** 2 for k in range(3))) for i, j in pairs]
    H = sum(x**2 / (2 * masses[k // 3]) for k, x in enumerate(p)) + extra * q[0]
    H -= sum(masses[i] * masses[j] / x for (i, j), x in zip(pairs, r, strict=True))
    return Hamiltonian(q=q, p=p, H=H, singular=r, kepler=jacobi(masses, 1))


def test_sums_of_inverse_distances_are_recognized():
    """The distances may be between any two bodies, in either order; other potentials are not accepted."""
    system = small([sp.Integer(1), sp.Rational(1, 100), sp.Rational(1, 50)])
    found = planet_pairs.distances(system.potential, system.q)
    assert sorted(w for w, _ in found) == [sp.Rational(1, 5000), sp.Rational(1, 100), sp.Rational(1, 50)]
    assert all(sorted(row) == [-1, 0, 1] for _, row in found)
    q = system.q
    for other in (
        1 / sp.sqrt(q[0] ** 2 + q[1] ** 2 + 2 * q[2] ** 2),
        1 / sp.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + 1),
        1 / (q[0] ** 2 + q[1] ** 2 + q[2] ** 2),
        1 / sp.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[0] * q[4]),
        q[0],
    ):
        assert planet_pairs.distances(system.potential - other, q) is None, other
    mean = sp.sqrt(sum((2 * q[k] - q[3 + k] / 2) ** 2 for k in range(3)))
    ((weight, row),) = planet_pairs.distances(-3 / sp.expand(mean), q)
    assert (weight, row) == (3, [2, -sp.Rational(1, 2), 0])


@pytest.mark.parametrize(
    ("extra", "limit"), [(0, 20), (sp.Rational(1, 1000), 20), pytest.param(0, 1, marks=pytest.mark.thorough)]
)
def test_bodies_in_lanes_move_as_others(extra, limit, monkeypatch):
    """With an additional potential there are no lanes; with limit 1 states are arrays."""
    monkeypatch.setattr(codegen, "TUPLE_LIMIT", limit)
    bodies = 3
    masses = [sp.Integer(1), *(sp.Rational(1, 1000 * k) for k in range(1, bodies))]
    system = small(masses, extra)
    assert (planet_pairs.distances(system.potential, system.q) is None) == (extra != 0)
    angle, r = np.arange(1, bodies) * 2.0, np.arange(1.0, bodies)
    q = np.zeros((bodies, 3))
    q[1:] = np.transpose([r * np.cos(angle), r * np.sin(angle), 0.1 * np.sin(3 * angle)])
    v = np.zeros((bodies, 3))
    v[1:] = np.transpose([-np.sin(angle), np.cos(angle), 0 * angle]) / np.sqrt(r)[:, None]
    p = v * np.array([float(m) for m in masses])[:, None]
    state = {"q0": q.ravel(), "p0": p.ravel()}
    found = end(integrate(system, "wisdom-holman-aba-10-6-4", h=0.1, steps=30, **state))
    assert np.abs(found - elsewhere(system, state["q0"], state["p0"], 3.0)).max() < 1e-9


def motion(r0, inverse, eta, beta, mu, h, eps, table, memory, row, like):
    """Stand-in for `kepler_lanes.motion` that uses the scalar Kepler flow, and at times reports lanes as unsolved."""
    every, free = zip(r0, eta, beta, mu, strict=True), (-1.0, h, 0.0, -1.0, 0)
    f, g, df, dg, _ = np.transpose([kepler_flow.coefficients(*x, h, eps, table) if x[-1] else free for x in every])
    unsolved, inverse = eta.sum() > 0, dg / (r0 * f)
    f, dg = f * (mu > 0), dg * (mu > 0)
    return kepler_lanes.Motion(f, g, df, dg, unsolved, np.nan if unsolved else inverse)


def root(square, guess):
    """Stand-in for `kepler_lanes.root`, the square root and its inverse; fails if ``guess`` is not near."""
    assert np.abs(square * guess**2 - 1).max() < 1e-12
    return np.sqrt(square), 1 / np.sqrt(square)


@pytest.fixture
def in_lanes(monkeypatch):
    """Without compilation, replace lanes by NumPy arrays so that the code for lanes runs."""

    def begin():
        if codegen.compiled():
            return
        arrays = {"select": np.where, "sqrt": np.sqrt, "add": lambda *terms: vector.add(*map(np.array, terms))}
        for name, function in arrays.items():
            monkeypatch.setattr(planet_lanes, name, function)
        monkeypatch.setattr(kepler_lanes, "motion", motion)
        monkeypatch.setattr(kepler_lanes, "root", root)
        monkeypatch.setattr(
            planet_pairs, "codegen", SimpleNamespace(compiled=lambda: True, to_number=codegen.to_number)
        )

    return begin


@pytest.mark.parametrize("id", FAMILY)
def test_planets_compiled_and_uncompiled_agree(uncompiled, in_lanes, id):
    """Without compilation both with NumPy arrays as lanes and body by body."""
    script = "integrators/test_wisdom_holman.py"
    plain, counts = (uncompiled(script, "planets") if codegen.compiled() else planets([id]))[id]
    in_lanes()
    prepared = prepare(method(id), problem(PLANETS).system)
    step = prepared.step
    assert isinstance(step, planet_lanes.Planets)
    assert {table.shape[1] for table in (step.maps, step.parts, step.pairs)} == {len(step.like)} == {8}
    assert prepared.tally(3, counts[1])["iterations"] == 0
    found, counted = planets([id])[id]
    assert counted == counts
    for x, y in zip(found, plain, strict=True):
        x, y = (np.array([float.fromhex(a) for a in z]) for z in (x, y))
        assert np.abs(x - y).max() < 1e-13 * np.abs(y).max()


@pytest.mark.parametrize("part", [jacobi([1, 2], 1), jacobi([1] * 17, 1), KeplerPart(3, (1, sp.sqrt(2), 1), (0, 1, 1))])
def test_kepler_parts_without_lanes(in_lanes, part):
    """For these Kepler parts lanes are not used, whatever the rest of the system is."""
    in_lanes()
    assert planet_pairs.prepare(part, None, {}) is None


def test_three_bodies_have_lanes(in_lanes):
    in_lanes()
    system = small([sp.Integer(1), sp.Rational(1, 100), sp.Rational(1, 50)])
    assert isinstance(prepare(method("wisdom-holman"), system).step, planet_lanes.Planets)


@pytest.fixture(scope="module")
def fine():
    """The planets after 5000 days, computed by DOP853."""
    made = problem(PLANETS)
    return elsewhere(made.system, made.q0, made.p0, 5000.0)


#: Errors of positions after 5000 days with h = 50, and of the energy on the way, within a factor of 4.
ERRORS = {
    "wisdom-holman": (3e-7, 1e-7),
    "wisdom-holman-corrector": (5e-8, 1e-10),
    "wisdom-holman-saba-2": (1.4e-8, 8e-11),
    "wisdom-holman-saba-4": (4e-9, 1e-11),
}
#: Errors of the other methods, which are those of the reference and of round-off.
LEAST = (1e-11, 1e-14)


@pytest.mark.parametrize("id", FAMILY)
def test_errors_of_the_planets(fine, id):
    made = problem(PLANETS)
    s = integrate(made, id, h=50.0, steps=100)
    E = made.system.observe(made.system.H, s.q, s.p)
    found = np.abs(end(s) - fine)[:18].max(), np.abs(E / E[0] - 1).max()
    for error, expected, least in zip(found, ERRORS.get(id, (0, 0)), LEAST, strict=True):
        assert error < 4 * max(expected, least)
        assert error > expected / 4, "the table is out of date"
    for name, expression in made.invariants.items():
        kept = made.system.observe(expression, s.q, s.p)
        assert np.abs(kept - kept[0]).max() < 1e-18, name


if __name__ == "__main__":
    print(json.dumps({"result": {"orders": first_orders, "planets": planets}[sys.argv[1]]()}))
