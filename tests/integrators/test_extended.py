"""Methods in extended phase space beside plain implementations in 30 digits, and what holds of which map."""

from __future__ import annotations

import json
from fractions import Fraction
from unittest import mock

import mpmath
import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.measure.step_map import pair_defect
from phasebench.integrators.coefficients import copies
from phasebench.integrators.coefficients.fractions import triple_jump
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import extended
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping import kernel
from support.kinds import lanes_and_one_apart
from support.marks import compiled
from support.solutions import apart, distance

DIGITS = 30
MINE = [m.id for m in METHODS if m.family in ("extended", "semiexplicit")] + ["extended-midpoint-4"]
H, STEPS = Fraction(1, 40), (1, 50)

# -- plain implementations, from the papers' formulae ------------------------------------------------------------------


def gradient_of_tao(q, p):
    """(H_q, H_p) of (q^2 + 1)(p^2 + 1) / 2."""
    return [q[0] * (p[0] ** 2 + 1)], [p[0] * (q[0] ** 2 + 1)]


def gradient_of_coupled(q, p):
    """(H_q, H_p) of |p|^2/2 + q1 p1 p2/4 + (q1^2 - 1)^2/4 + q2^2/2 + q1^2 q2 p2/3."""
    (a, b), (u, v) = q, p
    by_q = [u * v / 4 + a * (a**2 - 1) + 2 * a * b * v / 3, b + a**2 * v / 3]
    return by_q, [u + a * v / 4, v + a * u / 4 + a**2 * b / 3]


GRADIENTS = {"tao": gradient_of_tao, "coupled": gradient_of_coupled}


def plus(x, c, y):
    """x + c y."""
    return [a + c * b for a, b in zip(x, y, strict=True)]


def flow_a(gradient, h, z):
    """H(q, y) over h."""
    q, p, x, y = z
    by_q, by_y = gradient(q, y)
    return q, plus(p, -h, by_q), plus(x, h, by_y), y


def flow_b(gradient, h, z):
    """H(x, p) over h."""
    q, p, x, y = z
    by_x, by_p = gradient(x, p)
    return plus(q, h, by_p), p, x, plus(y, -h, by_x)


def flow_c(omega, h, z):
    """Tao's bond over h: the matrix of his paper on (q - x, p - y), the sums unchanged."""
    q, p, x, y = z
    c, s = mpmath.cos(2 * omega * h), mpmath.sin(2 * omega * h)
    u, v = plus(q, -1, x), plus(p, -1, y)
    u, v = plus([c * a for a in u], s, v), plus([c * a for a in v], -s, u)
    both, half = (plus(q, 1, x), plus(p, 1, y)), mpmath.mpf(1) / 2
    return tuple([half * a for a in plus(m, sign, t)] for sign in (1, -1) for m, t in zip(both, (u, v), strict=True))


def tao(gradient, h, z, omega):
    """A, B, C, B, A."""
    for flow, of, length in (
        (flow_a, gradient, h / 2),
        (flow_b, gradient, h / 2),
        (flow_c, omega, h),
        (flow_b, gradient, h / 2),
        (flow_a, gradient, h / 2),
    ):
        z = flow(of, length, z)
    return z


def leapfrog(gradient, h, z):
    """A, B, A."""
    return flow_a(gradient, h / 2, flow_b(gradient, h, flow_a(gradient, h / 2, z)))


def jumped(step, order, h, z):
    """Yoshida's triple jump, recursively, of a step (h, z) -> z of order 2."""
    if order == 2:
        return step(h, z)
    g = 1 / (2 - mpmath.mpf(2) ** (mpmath.mpf(1) / (order - 1)))
    for c in (g, 1 - 2 * g, g):
        z = jumped(step, order - 2, c * h, z)
    return z


def plain(id, name, steps, **changed):
    """(q, p) after some steps, as one list."""
    _, q, p = SYSTEMS[name]()
    q, p = [mpmath.mpf(x) for x in q], [mpmath.mpf(x) for x in p]
    gradient, h = GRADIENTS[name], mpmath.mpf(H.numerator) / H.denominator
    kind, _, order = id.rpartition("-")
    z = q, p, q, p
    for _ in range(steps):
        if kind == "tao":
            z = jumped(lambda h, z: tao(gradient, h, z, changed.get("omega", 20)), int(order), h, z)
        elif kind == "pihajoki":
            z = jumped(lambda h, z: leapfrog(gradient, h, z), int(order), h, z)
        elif kind == "jayawardana-ohsawa":
            z = projected(lambda h, z: jumped(lambda h, z: leapfrog(gradient, h, z), int(order), h, z), h, z)
        else:
            q, p, x, y = jumped(lambda h, z: leapfrog(gradient, h, z), int(order), h, z)
            q, p = ([(a + b) / 2 for a, b in zip(*of, strict=True)] for of in ((q, x), (p, y)))
            z = q, p, q, p
    return [*z[0], *z[1]]


def projected(step, h, z):
    """Symmetric projection of Jayawardana and Ohsawa: their simplified Newton iteration for mu, to its end."""
    d = len(z[0])
    mu = [mpmath.mpf(0)] * (2 * d)
    while True:
        ahead = (
            *(plus(a, 1, m) for a, m in zip(z[:2], (mu[:d], mu[d:]), strict=True)),
            *(plus(a, -1, m) for a, m in zip(z[2:], (mu[:d], mu[d:]), strict=True)),
        )
        q, p, x, y = step(h, ahead)
        q, p, x, y = plus(q, 1, mu[:d]), plus(p, 1, mu[d:]), plus(x, -1, mu[:d]), plus(y, -1, mu[d:])
        off = [*plus(q, -1, x), *plus(p, -1, y)]
        if max(map(abs, off)) < mpmath.mpf(10) ** (3 - mpmath.mp.dps):
            return q, p, q, p
        mu = plus(mu, mpmath.mpf(-1) / 4, off)


# -- measured without compilation -------------------------------------------------------------------------------------


def differences() -> dict:
    """{method: {system: {steps: distance from the plain implementation}}}, and of Tao's with another omega."""
    found: dict = {}
    with precision(DIGITS):
        for id in MINE:
            found[id] = {}
            for name in GRADIENTS:
                system, q, p = SYSTEMS[name]()
                ends = [
                    integrate(system, id, h=H, steps=n, q0=q, p0=p, save_every=0, arithmetic=MULTIPRECISION)
                    for n in STEPS
                ]
                with mpmath.workdps(DIGITS + 10):
                    exact = [plain(id, name, n) for n in STEPS]
                    other = plain(id, name, 1, omega=21)
                found[id][name] = [distance(s, y) for s, y in zip(ends, exact, strict=True)]
                found[id][f"{name}, another omega"] = [distance(ends[0], other)]
    return found


def pair_map(record: Method, system, h, steps=1):
    """The map of (q, p, x, y) by some steps, which starts from a copy that is another state."""
    d = system.d
    prepared = kernel.prepare(record, system, MULTIPRECISION)

    def advance(z, h=h):
        run = lay_out(prepared, d, h, z[:d], z[2 * d : 3 * d], MULTIPRECISION)
        run.carry.state[extended.COPY, :d], run.carry.state[extended.COPY + 1, :d] = z[d : 2 * d], z[3 * d :]
        run.counts.steps = 1  # a step was taken: the copy is read, not made
        rows = np.zeros((2, 1, d), dtype=object)
        run(*rows, np.zeros((1, 1)), steps)
        table = run.carry.state
        return np.concatenate([table[k, :d] for k in (0, extended.COPY, 1, extended.COPY + 1)])

    return advance


def structure() -> dict:
    """{method: (defect of symplecticity, distance after a step forth and back) of both copies}, and controls."""
    system, q, p = SYSTEMS["coupled"]()
    found, h = {}, to_number(H, MULTIPRECISION)
    with precision(40):
        z = vector([*q, *(x + 0.1 for x in q), *p, *(x - 0.05 for x in p)])

        def measured(record):
            advance = pair_map(record, system, h)
            return float(pair_defect(advance, z)), float(max(abs(advance(advance(z), -h) - z)))

        for id in ("tao-2", "tao-4", "pihajoki-2"):
            found[id] = measured(method(id))
        cos = extended.cos
        with mock.patch.object(extended, "cos", lambda x: cos(x) * (1 + to_number(Fraction(1, 10**9), MULTIPRECISION))):
            found["no rotation"] = measured(method("tao-2"))
        prepare = extended.prepare

        def unequal(*arguments):
            made = prepare(*arguments)
            made.step.after.flags.writeable = True
            made.step.after[1] *= 1 + to_number(Fraction(1, 10**9), MULTIPRECISION)
            return made

        with mock.patch.object(extended, "prepare", unequal):
            found["unequal halves"] = measured(method("tao-2"))
    return found


@pytest.fixture(scope="module")
def there(uncompiled):
    """Results of this module without compilation."""
    return uncompiled("integrators/test_extended.py")


@pytest.mark.parametrize("id", MINE)
@pytest.mark.parametrize("name", GRADIENTS)
def test_steps_are_those_of_a_plain_implementation(there, id, name):
    one, fifty = there["differences"][id][name]
    assert one < 1e-28
    assert fifty < 1e-26


@pytest.mark.parametrize("name", GRADIENTS)
@pytest.mark.parametrize("id", ["tao-2", "tao-4", "tao-6"])
def test_control_another_omega_is_another_method(there, id, name):
    assert there["differences"][id][f"{name}, another omega"][0] > 1e-10


@pytest.mark.parametrize("id", MINE)
def test_compiled_steps_are_those_of_a_plain_implementation(id):
    for name in GRADIENTS:
        system, q, p = SYSTEMS[name]()
        s = integrate(system, id, h=float(H), steps=50, q0=q, p0=p)
        with mpmath.workdps(DIGITS):
            assert distance(s, plain(id, name, 50)) < 2e-14


# -- what holds of which map ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", ["tao-2", "tao-4", "pihajoki-2"])
def test_the_map_of_both_copies_is_symplectic_and_symmetric(there, id):
    symplecticity, symmetry = there["structure"][id]
    assert symplecticity < 1e-26
    assert symmetry < 1e-36


def test_controls_of_the_map_of_both_copies(there):
    """A turn that is no rotation is not symplectic; unequal halves of B are, and are not symmetric."""
    assert there["structure"]["no rotation"][0] > 1e-12
    assert there["structure"]["unequal halves"][0] < 1e-26
    assert there["structure"]["unequal halves"][1] > 1e-14


def stages(fractions):
    """Lengths w of the substeps, and the sign that tells A from B."""
    w = copies.lengths_of_a(fractions)
    w = [x for pair in zip(w, [*fractions, 0], strict=True) for x in pair][:-1]
    return w, [(-1) ** i for i in range(len(w))]


def semiexplicit_tableau(fractions):
    """The tableau that `families.semiexplicit` states: (A, b)."""
    w, s = stages(fractions)
    n = range(len(w))
    return [[s[i] * s[j] * w[j] / 4 + (w[j] if j < i and s[i] != s[j] else 0) for j in n] for i in n], [
        x / 2 for x in w
    ]


def tableau_defect(A, b):
    """How far a tableau misses the conditions b_i a_ij + b_j a_ji = b_i b_j of a symplectic method."""
    pairs = [(i, j) for i in range(len(b)) for j in range(len(b))]
    return max(abs(b[i] * A[i][j] + b[j] * A[j][i] - b[i] * b[j]) for i, j in pairs)


def implicit_step(A, b, gradient, q, p, h):
    """A step of a Runge-Kutta method, by fixed point."""
    n, k = len(b), None
    while True:
        k, old = [], k or [([0 * x for x in q], [0 * x for x in p])] * n
        for row in A:
            at = [plus_all(y, h, row, [o[i] for o in old]) for i, y in enumerate((q, p))]
            by_q, by_p = gradient(*at)
            k.append((by_p, [-x for x in by_q]))
        at_once = [[x for both in of for part in both for x in part] for of in (k, old)]
        if max(map(abs, plus(at_once[0], -1, at_once[1]))) < mpmath.mpf(10) ** (3 - mpmath.mp.dps):
            return [x for i, y in enumerate((q, p)) for x in plus_all(y, h, b, [o[i] for o in k])]


def plus_all(y, h, weights, slopes):
    """y + h sum of weights times slopes."""
    for c, slope in zip(weights, slopes, strict=True):
        y = plus(y, h * c, slope)
    return y


@pytest.mark.parametrize("order", [2, 4])
def test_the_semiexplicit_method_is_a_symplectic_runge_kutta_method(order):
    with mpmath.workdps(40):
        A, b = semiexplicit_tableau(triple_jump(order))
        assert tableau_defect(A, b) < 1e-38
        for name, gradient in GRADIENTS.items():
            _, q, p = SYSTEMS[name]()
            q, p = [mpmath.mpf(x) for x in q], [mpmath.mpf(x) for x in p]
            end = implicit_step(A, b, gradient, q, p, mpmath.mpf(1) / 40)
            exact = plain(f"jayawardana-ohsawa-{order}", name, 1)
            assert apart(end, exact) < 1e-35
            A[0][0] += mpmath.mpf(10) ** -9
            other = implicit_step(A, b, gradient, q, p, mpmath.mpf(1) / 40)
            assert apart(other, exact) > 1e-14, "the control"
            A[0][0] -= mpmath.mpf(10) ** -9


def test_the_tableau_of_order_two():
    A, b = semiexplicit_tableau(triple_jump(2))
    assert [[8 * x for x in row] for row in A] == [[1, -2, 1], [3, 2, -1], [1, 6, 1]]
    assert [4 * x for x in b] == [1, 2, 1]
    assert copies.midpoint_tableau(triple_jump(2)) == ((0, 0, 0), (0.5, 0, 0), (0, 1, 0), (0.25, 0.5, 0.25))


def test_no_explicit_tableau_is_symplectic():
    """Every explicit tableau misses the conditions; the midpoint rule meets them."""
    for id in [m.id for m in METHODS if m.id.startswith("extended-midpoint-")]:
        *A, b = method(id).data
        assert tableau_defect(A, b) > 0.01, id
    assert tableau_defect([[0.5]], [1.0]) == 0


# -- the copy ---------------------------------------------------------------------------------------------------------


def energy_error(id, name, h, steps, **parameters):
    """Largest relative error of H, and the largest of the first tenth."""
    system, q, p = SYSTEMS[name]()
    s = integrate(system, id, h=h, steps=steps, q0=q, p0=p, parameters=parameters)
    E = system.observe(system.H, s.q, s.p)
    error = np.abs(E / E[0] - 1)
    return error.max(), error[: steps // 10].max()


def test_free_copies_part_if_h_is_not_separable_and_bound_ones_stay():
    free, bound = (energy_error(id, "tao", 0.01, 3000) for id in ("pihajoki-2", "tao-2"))
    assert free[0] > 100 * free[1]
    assert bound[0] < 2 * bound[1] < 1e-4


def test_free_copies_are_stormer_verlet_if_h_is_separable():
    system, q, p = SYSTEMS["henon-heiles"]()
    ends = [integrate(system, id, h=0.05, steps=200, q0=q, p0=p) for id in ("pihajoki-2", "stormer-verlet", "tao-2")]
    assert np.abs(ends[0].q - ends[1].q).max() < 1e-13
    assert np.abs(ends[0].p - ends[1].p).max() < 1e-13
    assert np.abs(ends[0].q - ends[2].q).max() > 1e-8


@pytest.mark.parametrize("id", ["tao-2", "tao-4", "pihajoki-2"])
def test_the_copy_is_kept_from_row_to_row(id):
    """Rows change nothing; a run made anew from a row is another one."""
    system, q, p = SYSTEMS["coupled"]()
    every, last = (integrate(system, id, h=0.05, steps=100, q0=q, p0=p, save_every=n) for n in (1, 100))
    np.testing.assert_allclose(every.q[-1], last.q[-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(every.p[-1], last.p[-1], rtol=0, atol=1e-13)
    half = integrate(system, id, h=0.05, steps=50, q0=q, p0=p)
    anew = integrate(system, id, h=0.05, steps=50, q0=half.q[-1], p0=half.p[-1])
    assert np.abs(anew.q[-1] - last.q[-1]).max() > 1e-9


def test_a_prepared_run_makes_the_copy_anew():
    system, q, p = SYSTEMS["coupled"]()
    run = pb.prepare(system, "tao-2", q0=q, p0=p)
    first, again = run(0.05, 20), run(0.05, 20)
    assert (first[0] == again[0]).all()
    s = integrate(system, "tao-2", h=0.05, steps=20, q0=q, p0=p)
    np.testing.assert_allclose(first[0], s.q[-1], rtol=0, atol=1e-14)


def separate(n: int) -> pb.Hamiltonian:
    """n independent degrees of freedom, each with Tao's H."""
    q, p = ([f"{x}{i}" for i in range(n)] for x in "qp")
    return pb.Hamiltonian(q=q, p=p, H=" + ".join(f"({a}**2 + 1)*({b}**2 + 1)/2" for a, b in zip(q, p, strict=True)))


@pytest.mark.parametrize("id", MINE)
def test_arrays_step_as_tuples(id):
    n = codegen.TUPLE_LIMIT + 2
    q, p = np.linspace(0.1, 0.5, n), np.linspace(-0.7, 0.3, n)
    many = integrate(separate(n), id, h=0.02, steps=30, q0=q, p0=p)
    for i in (0, n - 1):
        one = integrate(separate(1), id, h=0.02, steps=30, q0=q[i : i + 1], p0=p[i : i + 1])
        assert abs(many.q[-1, i] - one.q[-1, 0]) < 1e-14
        assert abs(many.p[-1, i] - one.p[-1, 0]) < 1e-14


@compiled
@pytest.mark.parametrize("id", MINE)
def test_orbits_in_lanes_end_as_one_alone(id):
    system, q, p = SYSTEMS["coupled"]()
    assert lanes_and_one_apart(system, id, q, p, 0.01) < 1e-13


# -- omega ------------------------------------------------------------------------------------------------------------


def test_without_a_bond_two_halves_of_b_are_one():
    system, q, p = SYSTEMS["coupled"]()
    ends = [integrate(system, m, h=0.05, steps=50, q0=q, p0=p) for m in (method("tao-2", omega=0), "pihajoki-2")]
    assert np.abs(ends[0].q - ends[1].q).max() < 1e-13


def test_omega_is_any_number_that_is_not_negative():
    assert method("tao-4", omega=2.5).label == "tao-4(omega=2.5)"
    assert method("tao-4", omega="1/3").data[1] == Fraction(1, 3)
    with pytest.raises(InvalidInput, match="not negative"):
        method("tao-2", omega=-1)


if __name__ == "__main__":
    print(json.dumps({"result": {"differences": differences(), "structure": structure()}}))
