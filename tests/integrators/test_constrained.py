"""Systems with constraints g(q) = 0, and the methods that stay on their manifold."""

from __future__ import annotations

import pickle
import re

import mpmath
import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import multiprecision, step_map
from phasebench.benchmarks.measure.battery import CONSTRAINED, SYSTEMS, as_problem
from phasebench.integrators import ConstrainedHamiltonian, InvalidInput, integrate, integrate_ensemble, prepare
from phasebench.integrators.records.compositions import compose
from phasebench.integrators.registry import BY_ID

IDS = [id for id, m in BY_ID.items() if "constrained" in m.requires]
SPHERE = {"q": "x y z", "p": "u v w", "H": "(u**2 + v**2 + w**2)/2 + z"}
Q0, P0 = [0.6, 0.0, -0.8], [0.2, 1.0, 0.15]
DIGITS = 30


def on_sphere(*constraints, **more) -> ConstrainedHamiltonian:
    """A spherical pendulum, or with other constraints."""
    return ConstrainedHamiltonian(**SPHERE | more, constraints=constraints or ("x**2 + y**2 + z**2 = 1",))


# -- beside plain implementations in 30 digits -------------------------------------------------------------------------


def dot(a, b):
    return mpmath.fsum(x * y for x, y in zip(a, b, strict=True))


def plain_position(q, p, h):
    """(q_1, p_1/2) of the kick, the drift and the multiplier of a spherical pendulum, from a quadratic equation."""
    half = [p[0], p[1], p[2] - h / 2]
    free = [a + h * b for a, b in zip(q, half, strict=True)]
    # |free - s q|^2 = 1 with the smaller root s
    a, b, c = dot(q, q), dot(free, q), dot(free, free) - 1
    s = c / (b + mpmath.sqrt(b * b - a * c))
    return [x - s * y for x, y in zip(free, q, strict=True)], [x - s * y / h for x, y in zip(half, q, strict=True)]


def plain_rattle(q, p, h):
    """One step of RATTLE for the spherical pendulum."""
    q, half = plain_position(q, p, h)
    p = [half[0], half[1], half[2] - h / 2]
    along = dot(q, p) / dot(q, q)
    return q, [x - along * y for x, y in zip(p, q, strict=True)]


def plain_shake(q, p, h):
    """One step of SHAKE: its p is the mean of the momenta on either side of q."""
    q, before = plain_position(q, p, h)
    _, after = plain_position(q, [before[0], before[1], before[2] - h / 2], h)
    return q, [(x + y) / 2 for x, y in zip(before, after, strict=True)]


def plain_composed(q, p, h):
    """Three steps of RATTLE, of fractions of Yoshida's."""
    a = 1 / (2 - mpmath.cbrt(2))
    for c in (a, 1 - 2 * a, a):
        q, p = plain_rattle(q, p, c * h)
    return q, p


def start_in_digits():
    """(q, p) on the manifold in 30 digits, the nearest to the doubles `Q0`, `P0`."""
    q, p = ([mpmath.mpf(x) for x in y] for y in (Q0, P0))
    length = mpmath.sqrt(dot(q, q))
    q = [x / length for x in q]
    along = dot(q, p)
    return q, [x - along * y for x, y in zip(p, q, strict=True)]


PLAIN = {
    "rattle": plain_rattle,
    "shake": plain_shake,
    "rattle-yoshida-4": plain_composed,
    "lobatto-iiia-iiib-constrained-2": plain_rattle,
}


@pytest.mark.parametrize("id", PLAIN)
def test_steps_are_those_of_a_plain_implementation(id):
    with mpmath.workdps(DIGITS):
        q, p = start_in_digits()
        exact = [(q, p)]
        for _ in range(50):
            exact.append(PLAIN[id](*exact[-1], mpmath.mpf("0.0625")))
        s = integrate(on_sphere(), id, h=0.0625, steps=50, q0=np.array(q, float), p0=np.array(p, float))
        rows = np.array([[*q, *p] for q, p in exact], float)
    away = np.abs(np.hstack([s.q, s.p]) - rows).max(axis=1)
    assert away[1] < 1e-15
    assert away.max() < 2e-14
    other = next(f for f in PLAIN.values() if f is not PLAIN[id])
    with mpmath.workdps(DIGITS):
        wrong = np.array([x for y in other(*exact[0], mpmath.mpf("0.0625")) for x in y], float)
    assert np.abs(wrong - rows[1]).max() > 1e-7, "the control: another method's step"


def equations_of_lobatto(q, p, h):
    """(function of the unknowns, start, end state of the unknowns) of the pair with three stages on a sphere."""
    s6 = mpmath.mpf(1) / 6
    A = [[0, 0, 0], [5 * s6 / 4, 2 * s6, -s6 / 4], [s6, 4 * s6, s6]]
    B = [[s6, -s6, 0], [s6, 2 * s6, 0], [s6, 5 * s6, 0]]
    b = [s6, 4 * s6, s6]

    def parts(x):
        P, L, p1 = [x[3 * i : 3 * i + 3] for i in range(3)], x[9:12], x[12:15]
        Q = [[q[k] + h * sum(A[i][j] * P[j][k] for j in range(3)) for k in range(3)] for i in range(3)]
        return Q, P, L, p1

    def force(Q, lam):
        return [-2 * lam * Q[0], -2 * lam * Q[1], -1 - 2 * lam * Q[2]]

    def residual(*x):
        Q, P, L, p1 = parts(x)
        f = [force(Q[j], L[j]) for j in range(3)]
        out = [P[i][k] - p[k] - h * sum(B[i][j] * f[j][k] for j in range(3)) for i in range(3) for k in range(3)]
        out += [dot(Q[i], Q[i]) - 1 for i in (1, 2)] + [dot(Q[2], p1)]
        return out + [p1[k] - p[k] - h * sum(b[j] * f[j][k] for j in range(3)) for k in range(3)]

    return residual, [*p, *p, *p, 0, 0, 0, *p], lambda x: (parts(x)[0][2], parts(x)[3])


def test_a_collocation_step_solves_the_equations_in_30_digits():
    with mpmath.workdps(DIGITS):
        q, p = start_in_digits()
        s = integrate(
            on_sphere(),
            "lobatto-iiia-iiib-constrained-4",
            h=0.125,
            steps=3,
            q0=np.array(q, float),
            p0=np.array(p, float),
        )
        for n in range(1, 4):
            residual, start, end = equations_of_lobatto(q, p, mpmath.mpf("0.125"))
            q, p = end(list(mpmath.findroot(residual, start, solver="mdnewton", maxsteps=50)))
            assert np.abs(np.array([*q, *p], float) - [*s.q[n], *s.p[n]]).max() < 1e-15 * (1 + n)


# -- structure ---------------------------------------------------------------------------------------------------------


def test_orders_and_structure_are_measured_with_all_others():
    """On separable and non-separable systems, one and two constraints, without round-off: `measure.multiprecision`."""
    for what in ("orders", "symplecticity", "symmetry"):
        found = {id: {name for label, name in multiprecision.cells(what) if label == id} for id in IDS}
        for id in IDS:
            general = "constant mass matrix" not in BY_ID[id].requires
            assert found[id] == set(CONSTRAINED if general else CONSTRAINED[:2])


@pytest.mark.parametrize("name", CONSTRAINED)
@pytest.mark.parametrize("id", IDS)
def test_constraints_hold_to_round_off(id, name):
    problem = as_problem(name)
    system = problem.system
    if BY_ID[id].lacks(system):
        with pytest.raises(InvalidInput, match="constant mass matrix"):
            integrate(problem, id, h=0.02, steps=1)
        return
    s = integrate(problem, id, h=0.02, steps=1000)
    assert s.status == "ok"
    g, hidden = system.defects(s.q, s.p)
    assert np.abs(g).max() < 5e-15
    if BY_ID[id].tangent:
        assert np.abs(hidden).max() < 2e-14
    else:
        assert np.abs(hidden).max() > 1e-5


def defect(system, step, y):
    """The symplecticity defect on the manifold of a map of (q, p)."""

    def retract(x):
        return np.concatenate(system.retract(x[: system.d], x[system.d :]))

    return float(np.abs(step_map.restricted(step, retract, y, 1e-3)).max())


def test_control_a_projected_runge_kutta_method_is_not_symplectic_on_the_manifold():
    problem = as_problem("on-sphere")
    system, y = problem.system, np.array([*problem.q0, *problem.p0])

    def step(id):
        run = prepare(problem, id)

        def map(x):
            q, p, _ = run(0.25, 1, x[:3], x[3:])
            return np.concatenate(system.retract(q, p))

        return map

    assert defect(system, step("rattle"), y) < 1e-10
    assert defect(system, step("lobatto-iiia-iiib-constrained-4"), y) < 1e-10
    assert defect(system, step("rk4"), y) > 1e-7


def reversibility(id) -> float:
    """The defect of reversibility of a step on two rods."""
    problem = as_problem("rods")
    run = prepare(problem, id)

    def step(y):
        q, p, _ = run(0.1, 1, y[:4], y[4:])
        return np.concatenate([q, p])

    return step_map.reversibility_defect(step, np.array([*problem.q0, *problem.p0]))


@pytest.mark.parametrize("id", [id for id in IDS if BY_ID[id].symmetric])
def test_steps_are_reversible(id):
    assert reversibility(id) < 1e-14


def test_control_steps_of_a_runge_kutta_method_are_not_reversible():
    assert reversibility("rk4") > 1e-9


def test_energy_stays_bounded_where_an_ordinary_method_drifts():
    problem = as_problem("on-sphere")
    s = integrate(problem, "rattle", h=0.1, steps=40_000, save_every=10)
    error = np.abs(problem.system.energies(s.q, s.p) - problem.system.energies(s.q[:1], s.p[:1])[0])
    assert s.status == "ok"
    assert error[2000:].max() < 1.1 * error[:2000].max()
    assert integrate(problem, "rk4", h=0.1, steps=40_000, save_every=10).status == "diverged"


# -- the index-reduced system ------------------------------------------------------------------------------------------


def test_multipliers_are_those_of_the_twice_differentiated_constraint():
    system, *_ = SYSTEMS["on-ellipsoid"]()
    y = np.array([0.5, 0.3, 0.4, 0.2, -0.6, 0.3])
    f, h = system.vector_field(), 1e-3
    g = [system.defects(*((y + k * h * f(0, y)).reshape(2, 1, 3)))[1][0, 0] for k in (1, -1)]
    assert abs(g[0] - g[1]) / (2 * h) < 1e-6, "the hidden constraint has no slope along the field"
    free = system.free.vector_field()
    g = [system.defects(*((y + k * h * free(0, y)).reshape(2, 1, 3)))[1][0, 0] for k in (1, -1)]
    assert abs(g[0] - g[1]) / (2 * h) > 0.1, "the control: without multipliers it has"
    assert np.allclose(system.rates(y[None, :3], y[None, 3:])[:, 0], f(0, y), rtol=1e-14, atol=0)


def test_ordinary_methods_and_peers_run_and_leave_the_manifold():
    problem = as_problem("rods")
    rough = integrate(problem, "rk4", h=0.05, t_end=5.0)
    assert rough.status == "ok"
    assert 1e-9 < np.abs(problem.system.defects(rough.q, rough.p)[0]).max() < 1e-2
    fine = integrate(problem, "lobatto-iiia-iiib-constrained-6", h=0.01, t_end=2.0)
    peer = pb.integrate(problem, "heyoka", t_end=2.0)
    assert np.abs(fine.q[-1] - peer.q[-1]).max() < 1e-11
    for id in ("scheme-iv", "rk4-projected-energy", "avf"):
        with pytest.raises(InvalidInput, match="canonical"):
            integrate(problem, id, h=0.05, t_end=1.0)
    with pytest.raises(InvalidInput, match="constrained"):
        integrate(pb.problem("pendulum"), "rattle", h=0.1, t_end=1.0)


def chain(n: int) -> tuple[ConstrainedHamiltonian, np.ndarray]:
    """A hanging chain of n rods in the plane, and its coordinates where it is straight."""
    q = [f"{a}{i}" for i in range(1, n + 1) for a in "xy"]
    H = " + ".join([*(f"p{a}**2/2" for a in q), *(f"y{i}" for i in range(1, n + 1))])
    rods = [
        "x1**2 + y1**2 = 1",
        *(f"(x{i} - x{i - 1})**2 + (y{i} - y{i - 1})**2 = 1" for i in range(2, n + 1)),
    ]
    straight = np.array([x for i in range(1, n + 1) for x in (0.8 * i, -0.6 * i)])
    return ConstrainedHamiltonian(q=q, p=[f"p{a}" for a in q], H=H, constraints=rods), straight


def test_many_constraints_and_arrays():
    system, q = chain(11)
    s = integrate(system, "rattle", h=0.01, steps=200, q0=q, p0=0 * q)
    assert s.status == "ok"
    assert np.abs(system.defects(s.q, s.p)).max() < 5e-14
    assert np.abs(np.ptp(system.energies(s.q, s.p))) < 1e-3
    with pytest.raises(InvalidInput, match="closed form"):
        _ = system.dp


def test_ensembles_in_lanes_agree_with_single_orbits():
    system, rng = on_sphere(), np.random.default_rng(0)
    states = [system.nearest(rng.normal(size=3), rng.normal(size=3)) for _ in range(20)]
    Q, P = (np.array(x) for x in zip(*states, strict=True))
    Q[3] *= 1.1
    found = integrate_ensemble(system, "rattle", Q, P, h=0.05, steps=40, lanes=True)
    assert found.status[3] == "invalid"
    assert found.in_lanes.sum() == 19
    for i in (0, 7, 19):
        s = integrate(system, "rattle", h=0.05, steps=40, q0=Q[i], p0=P[i])
        assert np.abs(s.q[-1] - found.q[i]).max() < 1e-14


def test_a_step_without_multipliers_says_so():
    s = integrate(on_sphere(), "rattle", h=3.0, steps=10, q0=Q0, p0=[0.0, 5.0, 0.0])
    assert s.status == "not-converged"
    assert "multipliers" in s.reason


def test_systems_are_pickled():
    system = pickle.loads(pickle.dumps(on_sphere()))
    assert system.constraints == on_sphere().constraints
    system.check_start(np.array(Q0), np.array([0.0, 1.0, 0.0]))


def test_compositions_of_rattle_are_made_like_others():
    found = compose(BY_ID["rattle"], "yoshida-6a")
    assert (found.order, found.symmetric, found.family) == (6, True, "rattle")
    with pytest.raises(InvalidInput, match="symmetric"):
        compose(BY_ID["shake"], "yoshida-6a")


# -- bad input ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("constraints", "said"),
    [
        (["x*u"], "momentum u"),
        (["1"], "none of the coordinates"),
        (["x = y = 1"], "the character '=' stands in no formula"),
        (["x + k"], "'k' is none of the variables"),
        ([], "no constraint"),
        (["x", "y", "z"], "as many constraints as coordinates"),
        (["x", "y", "z", "x + y"], "more constraints than coordinates"),
    ],
)
def test_bad_constraints(constraints, said):
    with pytest.raises(InvalidInput, match=said):
        ConstrainedHamiltonian(**SPHERE, constraints=constraints)


@pytest.mark.parametrize(
    ("q", "p", "worst"),
    [
        ([0.6, 0.1, -0.8], [0.8, 0.0, 0.6], r"the constraint x\*\*2 .* is 0\.01 there"),
        (Q0, [0.1, 1.0, 0.0], r"the hidden constraint 2\*.* is 0\.12 there"),
        ([3.0, 0.0, 0.1], P0, r"the hidden constraint 2\*.* is 1\.23 there"),
    ],
)
def test_a_start_off_the_manifold_is_refused_with_one_on_it(q, p, worst):
    """The message names the constraint that is missed by most, relative to its round-off."""
    with pytest.raises(InvalidInput) as told:
        integrate(on_sphere(), "rattle", h=0.1, steps=1, q0=q, p0=p)
    text = str(told.value)
    assert re.search(worst, text)
    near = [[float(x) for x in m.split(",")] for m in re.findall(r"\[([^\]]*)\]", text)]
    assert integrate(on_sphere(), "rattle", h=0.1, steps=1, q0=near[0], p0=near[1]).status == "ok"
    exact = np.array(q) / np.linalg.norm(q)
    assert np.abs(near[0] - exact).max() < 1e-14
    assert np.abs(near[1] - (np.array(p) - exact * (exact @ p))).max() < 1e-14


def test_the_nearest_start_is_nearest_in_the_metric_of_the_masses():
    system = ConstrainedHamiltonian(q="x y", p="u v", H="u**2/2 + v**2/8", constraints=["x + y = 1"])
    q, p = system.nearest([1.0, 1.0], [1.0, 1.0])
    assert np.allclose(q, [0.2, 0.8], atol=1e-15)  # M (q - q0) is along G
    assert np.allclose(p, [0.0, 0.0], atol=1e-15)


def test_redundant_constraints_are_named():
    system = on_sphere("x**2 + y**2 + z**2 = 1", "2*x**2 + 2*y**2 + 2*z**2 = 2")
    with pytest.raises(InvalidInput, match=r"redundant.*2\*x\*\*2"):
        integrate(system, "rattle", h=0.1, steps=1, q0=Q0, p0=[0.0, 1.0, 0.0])
    with pytest.raises(InvalidInput, match="no slope"):
        integrate(on_sphere("x**2*y"), "rattle", h=0.1, steps=1, q0=[0.0, 0.0, 1.0], p0=P0)
    flat = ConstrainedHamiltonian(q="x y", p="u v", H="u**2/2 + x*v", constraints=["y"])
    with pytest.raises(InvalidInput, match="not determined"):
        integrate(flat, "rk4", h=0.1, steps=1, q0=[0.0, 0.0], p0=[0.0, 0.0])
