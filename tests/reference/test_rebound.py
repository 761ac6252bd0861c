"""REBOUND's integrators: how a system is given to them, what they refuse, where they would go wrong."""

from __future__ import annotations

import signal
import warnings

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.outer_solar_system import BODIES, G
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.peers import BY_ID, PEERS, forms, integrate_peer, interrupts, particles
from phasebench.reference.peers import rebound as peers
from phasebench.reference.peers.forms import CENTRAL, GRAVITY, POTENTIAL
from phasebench.reference.peers.prepared import prepare_peer
from phasebench.reference.peers.record import NotHere
from phasebench.reference.solvers.taylor import reference

rebound = pytest.importorskip("rebound")

# -- how a system is given --------------------------------------------------------------------------------------------

#: Problem with parameters -> the ways to give it, the masses of the first of them.
GIVEN = {
    ("kepler",): ([CENTRAL, POTENTIAL], (1.0, 0.0)),
    ("perturbed-kepler",): ([CENTRAL, POTENTIAL], (1.0, 0.0)),
    ("outer-solar-system",): ([GRAVITY, POTENTIAL], tuple(m for m, _, _ in BODIES.values())),
    ("n-body", ("N", 5)): ([GRAVITY, POTENTIAL], (1.0,) * 5),
    ("henon-heiles",): ([POTENTIAL], (0.0,)),
    ("fpu",): ([POTENTIAL], (0.0, 0.0)),
    ("double-pendulum",): ([], ()),
}


@pytest.mark.parametrize("which", GIVEN, ids=lambda x: x[0])
def test_accelerations_are_those_of_the_system(which):
    """From rest, a leapfrog step of length 1 ends with the acceleration as its velocity."""
    name, *parameters = which
    here = problem(name, **dict(parameters))
    system, (kinds, masses) = here.system, GIVEN[which]
    settings = forms.settings(system)
    assert [*settings] == kinds
    q = np.array(here.q0) + np.random.default_rng(1).normal(size=system.d) / 10
    for kind, setting in settings.items():
        assert setting.masses == (masses if kind == kinds[0] else (0.0,) * -(-system.d // 3))
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
def test_gravity_between_two_bodies_is_recognized(kinetic, potential, kind):
    found = forms.settings(Hamiltonian(q="x y z w", p="a b c d", H=f"{kinetic} + {potential}"))
    assert next(iter(found), None) == kind
    if kind == GRAVITY:
        assert (found[kind].masses, found[kind].G, found[kind].dimension) == ((2.0, 3.0), 3.0, 2)


@pytest.mark.parametrize(("last", "kind"), [("1", GRAVITY), ("2", POTENTIAL)])
def test_gravity_has_a_single_constant(last, kind):
    pairs = {(1, 2): "1", (1, 3): "1", (2, 3): last}
    V = "".join(f" - {c}/sqrt((x{i} - x{j})**2 + (y{i} - y{j})**2)" for (i, j), c in pairs.items())
    T = "(a1**2 + b1**2 + a2**2 + b2**2 + a3**2 + b3**2)/2"
    system = Hamiltonian(q="x1 y1 x2 y2 x3 y3", p="a1 b1 a2 b2 a3 b3", H=T + V)
    assert next(iter(forms.settings(system))) == kind
    assert forms.settings(problem("outer-solar-system").system)[GRAVITY].G == G


# -- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("id", "name", "parameters", "what"),
    [
        ("whfast", "pendulum", {}, "body to revolve around"),
        ("ias15", "double-pendulum", {}, "V\\(q\\) alone"),
        ("whfast512", "perturbed-kepler", {}, "Newtonian gravity alone"),
        ("whfast512", "n-body", {"N": 10}, "at most 9 bodies, not 10"),
        ("saba-cm-2", "perturbed-kepler", {}, "Newtonian gravity alone"),
        ("saba-10-6-4", "figure-eight", {}, "body 3 .* singular"),
    ],
)
def test_unsupported_problems_are_refused_for_a_reason(id, name, parameters, what):
    with pytest.raises(InvalidInput, match=what):
        integrate_peer(problem(name, **parameters), f"rebound-{id}", t_end=1.0, steps=10)


@pytest.mark.lowest
def test_without_avx512_whfast512_is_refused_on_this_machine_alone(monkeypatch):
    monkeypatch.setattr(rebound, "avx512_available", False)
    made = problem("kepler")
    assert isinstance(BY_ID["rebound-whfast512"].lacks(made, made.system), NotHere)
    with pytest.raises(InvalidInput, match="AVX512"):
        integrate_peer(made, "rebound-whfast512", t_end=1.0, h=0.1)


def test_without_compilation_extra_forces_are_refused(monkeypatch):
    monkeypatch.setattr("numba.config.DISABLE_JIT", True)
    with pytest.raises(InvalidInput, match="NUMBA_DISABLE_JIT"):
        integrate_peer(problem("pendulum"), "rebound-ias15", t_end=1.0)
    assert integrate_peer(problem("kepler"), "rebound-ias15", t_end=1.0).status == "ok"


# -- traps ------------------------------------------------------------------------------------------------------------


def test_rebounds_warning_is_the_reason(monkeypatch):
    """If a number of the rows is not finite, a warning of REBOUND becomes the reason."""
    state = particles.state

    def spoiled(sim, setting):
        found = state(sim, setting)
        if sim.t > 0.25:
            warnings.warn("it went astray", RuntimeWarning, stacklevel=1)
            found[1] = np.nan
        return found

    monkeypatch.setattr(particles, "state", spoiled)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the warning must be caught
        s = integrate_peer(problem("pendulum"), "rebound-leapfrog", h=0.1, steps=5)
    assert (s.status, s.counts["steps"], len(s.t)) == ("diverged", 2, 3)
    assert s.reason.startswith("it went astray; ")


def test_ias15_passes_zeros_of_the_acceleration():
    """In the figure eight a body passes its centre at t = 1.05, where IAS15 with its default min_dt = 0 gets stuck."""
    here = problem("figure-eight")
    end = reference(here, [10.0], certify=False).q[0]
    assert np.abs(integrate_peer(here, "rebound-ias15", t_end=10.0).q[-1] - end).max() < 1e-12
    sim, _ = particles.build(forms.settings(here.system)[GRAVITY], here.q0, here.p0, "ias15")
    sim.steps(5000)
    assert 1 < sim.t < 1.06


@pytest.mark.parametrize("mode", peers.ADAPTIVE_MODES)
def test_the_adaptive_modes_of_ias15(mode, monkeypatch):
    kept, build = [], particles.build
    monkeypatch.setattr(particles, "build", lambda *a, **k: kept.append(build(*a, **k)) or kept[-1])
    p, made = peers.ias15(mode), problem("perturbed-kepler", e=0.2)
    assert (p.id == "rebound-ias15") == (mode == "prs23") == (p.least < 1e-11)
    assert integrate_peer(made, p, t_end=10.0, tol=1e-9).status == "ok"
    ((sim, _),) = kept
    assert (sim.integrator.adaptive_mode.lower(), sim.integrator.epsilon) == (mode, 1e-9)
    assert sim.integrator.min_dt == pytest.approx(1e-13 * 10)


@pytest.mark.parametrize(
    ("q", "p", "rows"), [([460.0, 0.0], [1.0, 0.0], 2), ([0.0, 460.0], [0.0, 1.0], 2), ([0.0, 0.0], [462.0, 0.0], 1)]
)
def test_janus_stops_before_its_integers_overflow(q, p, rows):
    free = Hamiltonian(q="x y", p="v w", H="(v**2 + w**2)/2 + 0*x*y")
    s = integrate_peer(free, "rebound-janus-2", h=1.0, steps=4, q0=q, p0=p)
    assert (s.status, len(s.t)) == ("diverged", rows)
    assert "beyond 461" in s.reason


@pytest.mark.parametrize("prepared", [False, True])
def test_ctrl_c_reaches_python_after_a_run(prepared):
    """REBOUND's C code takes the process's handler, and keeps it: the control."""
    # A test before this one may have run REBOUND by itself: Python's handler is put in anew.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    made, before = problem("kepler"), interrupts.handler()
    if prepared:
        prepare_peer(made, PEERS["rebound-ias15"]).advance(1.0)
    else:
        integrate_peer(made, "rebound-ias15", t_end=1.0)
    assert interrupts.handler() == before
    sim = rebound.Simulation()
    sim.add(m=1.0)
    sim.integrate(1.0)
    assert interrupts.handler() != before
    interrupts.put_back(before)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
