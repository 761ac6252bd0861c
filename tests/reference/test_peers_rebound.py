"""REBOUND's integrators as peers: forces, orders, restrictions, reversibility of JANUS."""

from __future__ import annotations

import re
import warnings
from functools import lru_cache

import numpy as np
import pytest

from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.outer_solar_system import BODIES, G
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.peers import BY_ID, PEERS, Task, integrate_peer, particles
from phasebench.reference.peers import rebound as peers
from phasebench.reference.peers.particles import CENTRAL, GRAVITY, POTENTIAL
from phasebench.reference.peers.record import NotHere
from phasebench.reference.solvers.taylor import reference

rebound = pytest.importorskip("rebound")

OURS = [p for p in PEERS if p.package == "rebound"]
FIXED = [p for p in OURS if not p.adaptive]
#: Problem -> (parameters, end, steps of the coarser run), at least one of each kind of setting.
SPANS = {
    "kepler": ({}, 3.0, 200),
    "perturbed-kepler": ({"e": 0.2}, 3.0, 80),
    "outer-solar-system": ({}, 10_000.0, 100),
    "n-body": ({}, 1.0, 40),
    "figure-eight": ({}, 1.0, 40),
    "pendulum": ({}, 3.0, 60),
    "henon-heiles:box": ({}, 3.0, 60),
    "toda": ({}, 1.0, 40),
    "fpu": ({}, 0.1, 20),
}
#: (peer, problem) -> observed order where it differs from the peer's.
MEASURED = {("rebound-whfast", "n-body"): 2}

#: JANUS rounds velocities to multiples of 1e-16; those of planets are of order 1e-3 au per day.
ROUND_OFF = {(f"rebound-janus-{n}", "outer-solar-system"): 1e-10 for n in (8, 10)}


@lru_cache(maxsize=32)
def truth(name):
    """Reference q at the end of a problem's time span."""
    parameters, end, _ = SPANS[name]
    return reference(problem(name, **parameters), [end], certify=False).q[0]


def distance(name, peer, steps) -> float:
    """Largest error of the coordinates at the end, relative to the largest coordinate."""
    parameters, end, _ = SPANS[name]
    s = integrate_peer(
        problem(name, **parameters), peer.id, t_end=end, steps=1 if peer.adaptive else steps, save_every=0
    )
    assert s.status == "ok", (peer.id, s.reason)
    assert peer.adaptive or s.counts["steps"] == steps
    return float(np.abs(s.q[-1] - truth(name)).max() / np.abs(truth(name)).max())


def available(peer, name) -> bool:
    """Whether a peer supports a problem."""
    made_here = problem(name, **SPANS.get(name, ({},))[0])
    return peer.lacks(made_here, made_here.system) is None


# -- how a system is passed to REBOUND ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*PROBLEMS, "n-body of 5"])
def test_accelerations_are_those_of_the_system(name):
    """From rest, a leapfrog step of length 1 ends with the acceleration as its velocity."""
    here = problem("n-body", N=5) if name == "n-body of 5" else problem(name)
    system = here.system
    settings = particles.settings(system)
    assert (not settings) == (not system.quadratic_kinetic)
    q = np.array(here.q0) + np.random.default_rng(1).normal(size=system.d) / 10
    for kind, setting in settings.items():
        wanted = np.hstack([system.observe(e, q[None], 0 * q[None]) for e in system.dp])
        ends = []
        for extra in (True, False):
            sim, force = particles.build(setting, q, 0 * q, "leapfrog", extra=extra)
            sim.dt = 1.0
            sim.steps(1)
            ends.append(particles.state(sim, setting)[system.d :])
            assert (force is None) == (setting.gradient is None or not extra)
        np.testing.assert_allclose(ends[0], wanted, rtol=0, atol=1e-14 * np.abs(wanted).max())
        assert (setting.gradient is None) == np.allclose(ends[1], wanted, rtol=1e-6, atol=0), kind


def test_masses_are_read_from_the_energy():
    found = particles.settings(problem("outer-solar-system").system)
    assert list(found) == [GRAVITY, POTENTIAL]
    assert found[GRAVITY].masses == tuple(m for m, _, _ in BODIES.values())
    assert found[GRAVITY].G == G
    five = particles.settings(problem("n-body", N=5).system)[GRAVITY]
    assert (five.masses, five.G, five.dimension) == ((1.0,) * 5, 0.2, 3)
    assert list(particles.settings(problem("perturbed-kepler", e=0.2).system)) == [CENTRAL, POTENTIAL]


@pytest.mark.parametrize(("name", "bodies"), [("henon-heiles", 1), ("toda", 1), ("fpu", 2)])
def test_a_body_holds_three_coordinates(name, bodies):
    setting = particles.settings(problem(name).system)[POTENTIAL]
    assert setting.masses == (0.0,) * bodies
    assert bodies - 1 < len(setting.inverse) / 3 <= bodies


@pytest.mark.parametrize(
    ("kinetic", "potential", "kind"),
    [
        ("(a**2 + b**2)/4 + c**2/6 + d**2/6", "-18/sqrt((z - x)**2 + (y - w)**2)", GRAVITY),
        ("(a**2 + b**2)/4 + c**2/6 + d**2/6", "18/sqrt((z - x)**2 + (y - w)**2)", POTENTIAL),
        ("(a**2 + b**2)/4 + c**2/6 + d**2/8", "-18/sqrt((z - x)**2 + (y - w)**2)", POTENTIAL),
        ("(a**2 + b**2 + c**2 + d**2)/2", "-1/((x - z)**2 + (y - w)**2)", POTENTIAL),
        ("(a**2 + b**2 + c**2 + d**2)/2", "-1/sqrt((x - z)**2 + 2*(y - w)**2)", POTENTIAL),
        ("(a**2 + b**2 + c**2 + d**2)/2", "-1/sqrt((x - z)**2 + (y - w)**2) + x", POTENTIAL),
        ("(a**2 + b**2 + c**2 + d**2)/2 + a*c", "x", None),
        ("a**2 + b**2 + c**2 + d**4", "x", None),
    ],
)
def test_gravity_between_bodies_is_recognized(kinetic, potential, kind):
    system = Hamiltonian(q="x y z w", p="a b c d", H=f"{kinetic} + {potential}")
    found = particles.settings(system)
    assert next(iter(found), None) == kind
    if kind == GRAVITY:
        assert (found[kind].masses, found[kind].G, found[kind].dimension) == ((2.0, 3.0), 3.0, 2)


@pytest.mark.parametrize(("last", "kind"), [("1", GRAVITY), ("2", POTENTIAL)])
def test_gravity_has_a_single_constant(last, kind):
    pairs = {(1, 2): "1", (1, 3): "1", (2, 3): last}
    V = "".join(f" - {c}/sqrt((x{i} - x{j})**2 + (y{i} - y{j})**2)" for (i, j), c in pairs.items())
    T = "(a1**2 + b1**2 + a2**2 + b2**2 + a3**2 + b3**2)/2"
    system = Hamiltonian(q="x1 y1 x2 y2 x3 y3", p="a1 b1 a2 b2 a3 b3", H=T + V)
    assert next(iter(particles.settings(system))) == kind


# -- every peer on every kind of problem ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPANS)
def test_every_peer_reaches_the_reference(name):
    """Halving the step reduces errors by the order or to round-off; adaptive peers meet their tolerance."""
    steps, wrong, run = SPANS[name][2], {}, 0
    for peer in OURS:
        if not available(peer, name):
            continue
        run += 1
        coarse = distance(name, peer, steps)
        if peer.adaptive:
            good = coarse < (1e-13 if peer.id == "rebound-ias15" else 1e-7)
        else:
            order = MEASURED.get((peer.id, name), peer.order)
            fine = distance(name, peer, 2 * steps)
            good = fine < max(1.3 * coarse / 2**order, ROUND_OFF.get((peer.id, name), 1e-12)) and coarse < 0.1
        if not good:
            wrong[peer.id] = (coarse,) if peer.adaptive else (coarse, fine)
    assert not wrong
    assert run >= 14


def test_peers_that_allow_no_extra_force():
    """The modified kick, and integrators that compute forces themselves, allow Newtonian gravity only."""
    here = problem("perturbed-kepler", e=0.2)
    lacking = {p.id: p.lacks(here, here.system) for p in OURS}
    without = [f"saba-cm-{n}" for n in (1, 2, 3, 4)] + ["whfast512", "whfast512-corrector-17"]
    without += ["whfast-modifiedkick", "eos-pmlf6"]
    assert {id for id, lack in lacking.items() if lack} == {f"rebound-{name}" for name in without}
    assert all("Newtonian gravity alone" in lack for lack in lacking.values() if lack)


def test_control_a_missing_extra_force_is_seen():
    parameters, end, _ = SPANS["perturbed-kepler"]
    without = reference(problem("kepler", **parameters), [end], certify=False).q[0]
    assert np.abs(without - truth("perturbed-kepler")).max() > 0.01
    assert all(distance("perturbed-kepler", p, 320) < 0.005 for p in OURS if available(p, "perturbed-kepler"))


#: Order -> steps for which the order is clearly observed.
LADDERS = {2: 40, 4: 28, 6: 20, 8: 20, 10: 14}


def ladder(name, peer, first):
    """Orders of a peer observed between runs whose numbers of steps have the ratio sqrt(2), from ``first`` on."""
    counts = [round(first * 2 ** (k / 2)) for k in range(3)]
    errors = [distance(name, peer, n) for n in counts]
    return np.diff(np.log(errors)) / -np.diff(np.log(counts))


@pytest.mark.parametrize("peer", FIXED, ids=lambda p: p.id)
def test_fixed_step_peers_have_their_order(peer):
    if peer.id == "rebound-eos-pmlf6":
        name, first = "figure-eight", 20
    elif peer.id == "rebound-whfast":
        name, first = "perturbed-kepler", 28
    else:
        name = "toda" if available(peer, "toda") else "n-body"
        first = LADDERS[peer.order]
    if not available(peer, name):
        pytest.skip("no AVX512")
    slopes = ladder(name, peer, first)
    assert (np.abs(slopes - peer.order) < 0.1).all(), slopes


def test_the_order_of_a_splitting_follows_from_its_description():
    told = {p.id: re.findall(r"eps(?:\^\d+)? h\^(\d+)", re.split("[:;]", p.about)[0]) for p in (*OURS, *peers.TRIED)}
    told = {id: min(map(int, exponents)) for id, exponents in told.items() if exponents}
    orders = {p.id: p.order for p in (*OURS, *peers.TRIED)}
    assert told == {id: orders[id] for id in told}
    assert sum("-saba-" in id for id in told) == sum("-saba-" in p.id for p in OURS) == 18
    assert set(orders) - set(told) == {
        id for id in orders if not re.match("rebound-(whfast|saba|mercurius|trace)", id)
    } | {f"rebound-whfast({kernel}, corrector2)" for kernel in ("default", "lazy", "modifiedkick", "composition")}


@pytest.mark.lowest
def test_the_lazy_kernel_has_order_2_between_bodies():
    """WHFast's lazy kernel in the n-body problem; the composition kernel and SABA's lazy corrector have order 4 there.

    Measured with REBOUND 5.2.2.
    """
    assert np.abs(ladder("n-body", BY_ID["rebound-whfast"], 40) - 2).max() < 0.1
    assert np.abs(ladder("n-body", BY_ID["rebound-whfast-composition"], 28) - 4).max() < 0.1
    assert np.abs(ladder("n-body", BY_ID["rebound-saba-cl-2"], 28) - 4).max() < 0.1


# -- restrictions -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("integrator", "options"),
    [
        ("whfast", {"corrector": 17, "kernel": "modifiedkick"}),
        ("saba", {"type": "CM_2"}),
        ("saba", {"type": "CM_4"}),
        ("eos", {"phi0": "PMLF6", "phi1": "LF8"}),
        ("whfast512", {}),
    ],
)
def test_unsupported_forces_are_refused_for_a_reason(integrator, options):
    """These integrators would ignore an extra force, or fall to order 2."""
    if integrator == "whfast512" and not rebound.avx512_available:
        pytest.skip("no AVX512")
    here, (_, end, _) = problem("perturbed-kepler", e=0.2), SPANS["perturbed-kepler"]
    setting, errors = particles.settings(here.system)[CENTRAL], []
    for n in (40, 80, 160):
        times = np.array([0.0, end])
        task = Task(here, here.system, np.array(here.q0), np.array(here.p0), end / n, [0, n], times, None)
        options = {"safe_mode": 0} | options if integrator != "whfast512" else {}
        run = particles.run(task, setting, integrator, options, adaptive=False)
        errors.append(np.abs(run.q[-1] - truth("perturbed-kepler")).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(slopes - (0 if integrator == "whfast512" else 2)).max() < 0.1


@pytest.mark.parametrize(
    ("id", "name", "parameters", "options", "what"),
    [
        ("whfast", "pendulum", {}, {"h": 0.1}, "body to revolve around"),
        ("trace", "henon-heiles", {}, {"h": 0.1}, "body to revolve around"),
        ("ias15", "double-pendulum", {}, {}, "V\\(q\\) alone"),
        ("janus-6", "lotka-volterra-log", {}, {"h": 0.1}, "V\\(q\\) alone"),
        ("whfast512", "perturbed-kepler", {}, {"h": 0.1}, "Newtonian gravity alone"),
        ("whfast512", "n-body", {"N": 10}, {"h": 0.1}, "at most 9 bodies, not 10"),
        ("saba-cm-2", "perturbed-kepler", {}, {"h": 0.1}, "Newtonian gravity alone"),
        ("saba-10-6-4", "figure-eight", {}, {"h": 0.1}, "body 3 .* singular"),
    ],
)
def test_unsupported_problems_are_refused(id, name, parameters, options, what):
    with pytest.raises(InvalidInput, match=what):
        integrate_peer(problem(name, **parameters), f"rebound-{id}", t_end=1.0, **options)


@pytest.mark.lowest
def test_without_avx512_whfast512_is_refused(monkeypatch):
    monkeypatch.setattr(rebound, "avx512_available", False)
    with pytest.raises(InvalidInput, match="AVX512"):
        integrate_peer(problem("kepler"), "rebound-whfast512", t_end=1.0, h=0.1)
    made = problem("kepler")
    assert isinstance(BY_ID["rebound-whfast512"].lacks(made, made.system), NotHere), "this machine alone lacks it"


def test_without_compilation_extra_forces_are_refused(monkeypatch):
    monkeypatch.setattr("numba.config.DISABLE_JIT", True)
    with pytest.raises(InvalidInput, match="NUMBA_DISABLE_JIT"):
        integrate_peer(problem("pendulum"), "rebound-ias15", t_end=1.0)
    assert integrate_peer(problem("kepler"), "rebound-ias15", t_end=1.0).status == "ok"


def test_singular_jacobi_coordinates_end_the_run():
    here = problem("figure-eight")
    s = integrate_peer(here.system, "rebound-whfast-plain", t_end=0.1, steps=10, q0=here.q0, p0=here.p0)
    assert (s.status, len(s.t)) == ("diverged", 1)


def test_rebounds_warning_is_the_reason(monkeypatch):
    """If a number of the rows is not finite, a warning of REBOUND becomes the reason."""
    here, state = problem("pendulum"), particles.state

    def spoiled(sim, setting):
        found = state(sim, setting)
        if sim.t > 0.25:
            warnings.warn("it went astray", RuntimeWarning, stacklevel=1)
            found[1] = np.nan
        return found

    monkeypatch.setattr(particles, "state", spoiled)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the warning must be caught
        s = integrate_peer(here, "rebound-leapfrog", h=0.1, steps=5)
    assert (s.status, s.counts["steps"], len(s.t)) == ("diverged", 2, 3)
    assert s.reason.startswith("it went astray; ")


# -- particulars ------------------------------------------------------------------------------------------------------


def test_ias15_passes_zeros_of_the_acceleration():
    """In the figure eight a body passes its centre at t = 1.05, where IAS15 with its default min_dt = 0 gets stuck."""
    here = problem("figure-eight")
    end = reference(here, [10.0], certify=False).q[0]
    assert np.abs(integrate_peer(here, "rebound-ias15", t_end=10.0).q[-1] - end).max() < 1e-12
    sim, _ = particles.build(particles.settings(here.system)[GRAVITY], here.q0, here.p0, "ias15")
    sim.steps(5000)
    assert 1 < sim.t < 1.06


@pytest.mark.parametrize(("id", "reversible"), [("janus-2", True), ("janus-10", True), ("leapfrog-6", False)])
@pytest.mark.parametrize("name", ["figure-eight", "toda"])
def test_janus_is_bitwise_reversible(id, reversible, name):
    here, (integrator, _, order) = problem(name), id.partition("-")
    setting = next(iter(particles.settings(here.system).values()))
    sim, force = particles.build(setting, here.q0, here.p0, integrator, {"order": int(order)})
    sim.dt = 0.01
    sim.steps(1)  # from here on the state is that of its integers
    start = particles.state(sim, setting)
    sim.steps(1000)
    there = particles.state(sim, setting)
    sim.dt = -0.01
    sim.steps(1000)
    assert (force is None) == (name == "figure-eight")
    assert np.abs(there - start).max() > 0.1
    assert (particles.state(sim, setting) == start).all() == reversible


def test_janus_stops_before_its_integers_overflow():
    free = Hamiltonian(q="x", p="v", H="v**2/2 - x")
    s = integrate_peer(free, "rebound-janus-4", t_end=40.0, steps=40, q0=[0.0], p0=[0.0])
    assert s.status == "diverged"
    assert "beyond 461" in s.reason
    assert s.q[-1, 0] == pytest.approx(s.t[-1] ** 2 / 2)
    assert s.t[-1] == 30


@pytest.mark.parametrize(
    ("q", "p", "rows"), [([460.0, 0.0], [1.0, 0.0], 2), ([0.0, 460.0], [0.0, 1.0], 2), ([0.0, 0.0], [462.0, 0.0], 1)]
)
def test_janus_stops_if_any_coordinate_or_velocity_is_too_large(q, p, rows):
    free = Hamiltonian(q="x y", p="v w", H="(v**2 + w**2)/2 + 0*x*y")
    s = integrate_peer(free, "rebound-janus-2", h=1.0, steps=4, q0=q, p0=p)
    assert (s.status, len(s.t)) == ("diverged", rows)
    assert "beyond 461" in s.reason


def test_leapfrog_evaluations_are_counted_correctly():
    for peer in (p for p in OURS if "-leapfrog" in p.id):
        sim, calls = rebound.Simulation(), [0]
        sim.add(m=1.0)
        sim.add(a=1.0)
        sim.integrator = "leapfrog"
        sim.integrator.order = peer.order
        sim.dt = 0.01

        def count(_, calls=calls):
            calls[0] += 1

        sim.additional_forces = count
        sim.steps(10)
        times = calls[0] // 10
        assert peer.about == f"{times} force evaluation{'' if times == 1 else 's'} a step"


def test_storing_rows_changes_whfast512_by_round_off():
    here = problem("outer-solar-system")
    if BY_ID["rebound-whfast512"].lacks(here, here.system):
        pytest.skip("no AVX512")
    every, end = (integrate_peer(here, "rebound-whfast512", h=50.0, steps=100, save_every=n) for n in (7, 0))
    plain = integrate_peer(here, "rebound-whfast-plain", h=50.0, steps=100, save_every=7)
    assert np.abs(every.q[-1] - end.q[-1]).max() < 1e-12
    assert np.abs(every.q - plain.q).max() < 1e-11


def test_a_looser_tolerance_makes_bs_less_accurate():
    here = problem("henon-heiles:box")
    tight, loose = (integrate_peer(here, "rebound-bs", t_end=30.0, tol=tol) for tol in (1e-13, 1e-4))
    end = reference(here, [30.0], certify=False).q[0]
    assert np.abs(loose.q[-1] - end).max() > 100 * np.abs(tight.q[-1] - end).max()


def test_ias15_and_taylor_agree_on_the_outer_solar_system(capsys):
    here, times = problem("outer-solar-system"), [10_000.0, 500_000.0]
    truth = reference(here, times, certify=False)
    ends = [integrate_peer(here, "rebound-ias15", t_end=t).q[-1] for t in times]
    apart = [float(np.abs(a - b).max()) for a, b in zip(ends, truth.q, strict=True)]
    with capsys.disabled():
        print(f"\nouter solar system, rebound-ias15 and Taylor series apart: {apart[0]:.2g} and {apart[1]:.2g} au")
    assert apart[0] < 2e-13
    assert apart[1] < 1e-9


def test_every_type_of_saba_is_a_peer():
    sim = rebound.Simulation()
    sim.integrator = "saba"
    offered = {line.split("'")[1] for line in sim.integrator.__doc__.splitlines() if " = '" in line} - {"DEFAULT"}
    ours = {p.id.removeprefix("rebound-saba-") for p in OURS if "-saba-" in p.id}
    assert ours == {name.lower().replace("_", "-") for name in offered}


def test_claims_cite_the_documentation():
    for p in OURS:
        assert "rebound.readthedocs.io" in p.claims.source
        assert p.claims.order in (None, p.order)


@pytest.mark.parametrize("mode", [m for m in peers.ADAPTIVE_MODES if m != "prs23"])
def test_other_modes_of_ias15_have_a_larger_least_tolerance(mode):
    with pytest.raises(InvalidInput, match="none below"):
        integrate_peer(problem("kepler"), peers.ias15(mode), t_end=0.1, tol=0.99e-11)
    assert integrate_peer(problem("kepler"), peers.ias15(mode), t_end=0.01, tol=1e-11).status == "ok"


@pytest.mark.timeout(60)
def test_an_escape_in_finite_time_ends_the_run():
    """A run whose orbit escapes in finite time is ended here: REBOUND would shrink its steps for ever."""
    solution = integrate_peer(problem("henon-heiles:chaotic"), "rebound-bs", tol=1e-2, t_end=1e4, steps=1)
    assert solution.status == "diverged"
    assert "farther away than 1e+12" in solution.reason
