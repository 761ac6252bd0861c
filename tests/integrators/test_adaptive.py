"""Variable-step methods: reversible in fictitious time, more efficient than fixed steps on eccentric orbits."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.driver import OK, TIMEOUT, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping.kernel import prepare
from support.solutions import end, energy_errors

ORBIT = problem("kepler", e=0.6)
PERIOD = 2 * np.pi


#: Rate of the rotating frame, in which H is not separable and the motion is reversible under a reflection.
RATE = 0.3
TURNING = Hamiltonian(
    q="x y",
    p="u v",
    H=f"u**2/2 + v**2/2 - {RATE}*(x*v - y*u) - 1/sqrt(x**2 + y**2)",
    singular=["sqrt(x**2 + y**2)"],
)


def there_and_back(id, h, n, reflected=True, system=ORBIT.system, mirror=(1, 1)):
    """Distance from the start after n steps forth and n back, with momenta (and step density) reversed in between."""
    record, mirror = method(id), np.array(mirror)
    prepared = prepare(record, system)
    forth, back = (lay_out(prepared, 2, h, ORBIT.q0, ORBIT.p0, DOUBLE) for _ in range(2))
    Q, P, parameter = np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 1))
    assert forth(Q, P, parameter, n) == (1, 0)
    q, p, _, _, (t, lost), (density, _) = forth.carry.state[:6, :2]
    back.carry.state[0, :2], back.carry.state[1, :2] = mirror * q, -mirror * p
    _, change = prepared.step.monitor(tuple(q), tuple(p))
    back.carry.state[5, :2] = density - reflected * h * change, -h
    back.carry.state[6, 0] = (t + lost) / h - n
    assert back(Q, P, parameter, n) == (1, 0)
    return max(np.abs(Q[0] - mirror * ORBIT.q0).max(), np.abs(P[0] + mirror * ORBIT.p0).max())


@pytest.mark.parametrize(
    ("id", "h", "of"),
    [
        ("stormer-verlet-adaptive", 0.05, {}),
        ("gauss-4-adaptive", 0.3, {}),
        ("gauss-8-adaptive", 0.9, {}),
        ("gauss-8-adaptive", 0.9, {"system": TURNING, "mirror": (1, -1)}),
    ],
)
def test_steps_are_reversible_in_fictitious_time(id, h, of):
    assert there_and_back(id, h, 20, **of) < 1e-11
    assert there_and_back(id, h, 20, reflected=False, **of) > 1e-9, "the control: a density not turned round"


def test_systems_without_a_time_scale_are_refused():
    with pytest.raises(InvalidInput, match="singular distances"):
        integrate(problem("henon-heiles"), "gauss-8-adaptive", h=0.1, steps=1)
    with pytest.raises(InvalidInput, match="separable"):
        integrate(TURNING, "stormer-verlet-adaptive", h=0.1, steps=1, q0=[1, 0], p0=[0, 1])
    for T in ("v**2/2", "x*v + v**2/2"):
        H = f"u**2/2 + {T} + (x**2 + y**2)**(1/3)"
        beyond = Hamiltonian(q="x y", p="u v", H=H, singular=["sqrt(x**2 + y**2)"])
        with pytest.raises(InvalidInput, match="derivatives made of"):
            integrate(beyond, "gauss-8-adaptive", h=0.1, steps=1, q0=[1, 0], p0=[0, 1])


#: Hard bounces: H, the turning point at which the orbit starts, the end; two walls, a wall of two coordinates.
BOUNCES = [
    ("p**2/2 + 1/q**2 + q - log(2 + q)/3", [0.03], 120),
    ("p**2/2 + 4*(1/q**12 - 1/q**6) + q**2/50", [0.6], 30),
    ("p1**2/2 + p2**2/2 + 1/(q1 - q2)**2 + (q1**2 + q2**2)/2", [0.02, 0.0], 20),
]


@pytest.mark.parametrize(("H", "q0", "t_end"), BOUNCES)
def test_variable_steps_hold_through_a_hard_bounce(H, q0, t_end):
    """The time scale of a turn, 1e-4 to 1e-9 of the span, is met by steps of a tenth of it; heyoka is the truth."""
    d = len(q0)
    q, p = ("q", "p") if d == 1 else ("q1 q2", "p1 p2")
    system = Hamiltonian(q=q, p=p, H=H)
    start = {"q0": q0, "p0": [0.0] * d, "t_end": t_end, "save_every": 0}
    true = pb.integrate(system, "heyoka", **start).q[-1]
    for h, error in ((0.2, 1e-7), (0.1, 1e-10)):
        s = integrate(system, "gauss-6-adaptive", h=t_end / round(t_end / h), **start)
        assert s.status == "ok"
        assert np.abs(s.q[-1] - true).max() < error * np.abs(true).max()


# -- steps that follow from the vector field ---------------------------------------------------------------------------


BY_ID = {m.id: m for m in METHODS if m.family == "field"}
KEPLER = problem("kepler", e=0.8)
#: A wall at q = 0; far from it the force is constant to all digits, so that nothing announces the wall.
WALL = Hamiltonian(q="q", p="p", H="p**2/2 + exp(-40*q) + q")


def lengths(system, id, h, q0, p0, every, rows=1):
    """(length of the next step, length of the last step, time, counts) after a run that stored some rows."""
    run = lay_out(prepare(BY_ID[id], system), system.d, h, q0, p0, DOUBLE)
    shape = (rows, system.d)
    assert run(np.zeros(shape), np.zeros(shape), np.zeros((rows, 1)), every)[1] == 0
    state = run.carry.state
    return state[5, 0], state[5, 1], state[4, 0], run.counts


def test_steps_on_a_kepler_orbit_follow_the_distance():
    """About as r^(3/2): at the apocentre, 9 times as far as the pericentre, they are about 27 times as long."""
    steps = []
    for half in (0, 1):
        t, h = (0.999 + half * 0.5) * PERIOD, 0.002
        steps.append(lengths(KEPLER.system, "gauss-8-field", h, KEPLER.q0, KEPLER.p0, round(t / h))[0])
    assert 20 < steps[1] / steps[0] < 50


def test_steps_into_a_wall_are_rejected():
    """Starting at q = 3 the steps grow at the largest rate; steps into the wall are rejected and repeated."""
    fine, s = (
        end(integrate(WALL, "gauss-8-field", t_end=10.0, steps=n, q0=[3.0], p0=[0.0], save_every=0))
        for n in (4000, 100)
    )
    assert np.abs(fine - s).max() < 1e-6
    assert np.abs(WALL.energies(fine[:1, None], fine[1:, None]) - 3).max() < 1e-13
    fixed = integrate(WALL, "gauss-8", t_end=10.0, steps=100, q0=[3.0], p0=[0.0], save_every=0)
    assert fixed.status != "ok" or np.abs(end(fixed) - fine).max() > 1e-3, "the control"


@pytest.mark.parametrize("id", ["gauss-6-field", "gauss-8-field"])
def test_no_step_passes_through_a_wall_to_the_same_energy(id):
    """H is even in q, so that its value does not tell on which side of 1/q^2 a step ends; the sign of q does."""
    wall = Hamiltonian(q="q", p="p", H="p**2/2 + 1/q**2 + q**2/2")
    s = integrate(wall, id, h=1e-4, t_end=40, q0=[0.01], p0=[0.0], save_every=4000)
    assert (s.q > 0).all()
    assert np.abs(energy_errors(s)).max() < 1e-3 * wall.energies([[0.01]], [[0.0]])[0]


def test_missing_traits_of_a_system_are_reported():
    beyond = Hamiltonian(q="x y", p="u v", H="u**2/2 + v**2/2 + (x**2 + y**2)**(1/3)")
    with pytest.raises(InvalidInput, match="elementary derivatives"):
        integrate(beyond, "gauss-8-field", h=0.1, steps=1, q0=[1, 0], p0=[0, 1])


@pytest.mark.parametrize(("name", "turned"), [("gauss-4-field", 1e-16), ("gauss-8-field", 1e-6)])
def test_a_coordinate_at_rest_does_not_shorten_steps(name, turned):
    """q' = 0 at p = 0 for H = exp(q) - q + exp(p) - p + ...; a tiny p must not make the steps shorter."""
    made = Hamiltonian(q="q", p="p", H="exp(q) - q + exp(p) - p + q**2*p**2/100")
    counts = [lengths(made, name, 0.5, [0.7], [p], 20)[3].steps for p in (0.0, turned)]
    assert abs(counts[0] - counts[1]) <= 1
    assert counts[1] < 100


def test_a_step_that_shrinks_to_zero_ends_the_run():
    """A fall into a centre that is not declared singular."""
    made = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q", singular=())
    ended = integrate(made, "gauss-4-field", h=0.1, t_end=10.0, q0=[1.0], p0=[0.0], timeout=60)
    assert ended.status not in (OK, TIMEOUT)
