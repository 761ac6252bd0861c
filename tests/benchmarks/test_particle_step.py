"""Steps of one's own of a charged particle, step(system, x, v, h): seen as steps of (q, p), certified, refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import phasebench as pb
from phasebench.benchmarks.certificate import battery, certificate
from phasebench.benchmarks.certificate.stepping import Exact
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS
from phasebench.benchmarks.measure import own_step
from phasebench.benchmarks.measure.battery import relativistic_particle
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile.codegen import precision, vector
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems import magnetic
from support.evidence import verdicts
from support.steps import leapfrog

BORIS = str(Path(__file__).parents[2] / "examples" / "boris.py")
PARTICLES = ("charged-particle", "magnetic-mirror")


def drift_only(system, x, v, h):
    return x + h * v, v


def trapezoid(system, x, v, h):
    """The explicit trapezoidal rule, of order 2: it keeps neither volume nor the two-form."""
    a = system.E(x) + np.cross(v, system.B(x))
    y, w = x + h * v, v + h * a
    return x + h / 2 * (v + w), v + h / 2 * (a + system.E(y) + np.cross(w, system.B(y)))


def midpoint(system, q, p, h):
    """The implicit midpoint rule in (q, p), iterated: symplectic."""
    a, b = q, p
    for _ in range(60):
        x, y = (q + a) / 2, (p + b) / 2
        a, b = q + h * system.dH_dp(x, y), p - h * system.dH_dq(x, y)
    return a, b


def own(step, *requires) -> own_step.OwnStep:
    return own_step.OwnStep(step.__name__, step, {}, requires or ("magnetic",))


# -- what a step sees -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PARTICLES)
def test_the_fields_are_those_of_the_particle_in_three_components(name):
    whole = problem(name)
    seen = own_step.System(whole.system).particle
    x, v = seen.state(np.array(whole.q0), np.array(whole.p0))
    E, B = seen.E(x), seen.B(x)
    assert [z.shape for z in (x, v, E, B)] == [(3,)] * 4
    assert seen.evaluations == [1, 1]
    if name == "charged-particle":
        assert v == pytest.approx([0.1, 0.01, 0.0], abs=1e-16)
        assert np.abs(E - [0.0, -0.01, 0.0]).max() < 1e-17
        assert B.tolist() == [0.0, 0.0, 1.0]
    else:
        assert v == pytest.approx([0.0, 0.3, 0.2], abs=1e-16)
        assert E.tolist() == [0.0, 0.0, 0.0]
        assert seen.B([1.0, 2.0, 5.0]) == pytest.approx([-0.05, -0.1, 1.25], rel=1e-15)
    d = whole.system.d
    assert seen.momentum(x, v) == pytest.approx(whole.p0, abs=1e-16)
    assert seen.H(x, v) == pytest.approx(whole.system.energies([whole.q0], [whole.p0])[0], rel=1e-15)
    assert x[:d].tolist() == list(whole.q0)


@pytest.mark.parametrize("entry", battery.magnetic(), ids=lambda e: e.name)
def test_in_many_digits_it_sees_the_same(entry):
    d, y = entry.system.d, np.array(entry.state)
    rough = own_step.System(entry.system).particle
    with precision(40):
        fine = Exact(entry.system).particle
        x, v = fine.state(vector(y[:d]), vector(y[d:]))
        for a, b in ((fine.E(x), rough.E(y[:d])), (fine.B(x), rough.B(y[:d])), (v, rough.state(y[:d], y[d:])[1])):
            assert np.abs((a - b).astype(float)).max() < 1e-15
        there = fine.momentum(x, v) - vector(y[d:])
        assert max(map(abs, there)) < 1e-38
        assert abs(float(fine.H(x, v)) - rough.H(y[:d], v.astype(float))) < 1e-14


@pytest.mark.parametrize("name", PARTICLES)
def test_a_step_of_ones_own_is_the_method(name):
    mine = pb.integrate(name, BORIS, h=0.1, t_end=20)
    its = pb.integrate(name, "boris", h=0.1, t_end=20)
    other = pb.integrate(name, "he-splitting-2", h=0.1, t_end=20)
    assert mine.status == "ok"
    assert np.abs(mine.q - its.q).max() < 1e-12
    assert np.abs(mine.p - its.p).max() < 1e-12
    assert np.abs(mine.q - other.q).max() > 1e-4
    assert mine.counts["gradient"] == its.counts["gradient"] == 200


def test_a_step_of_q_and_p_keeps_its_arguments():
    """A step is one of (x, v) only if it names them and requires a magnetic field; neither alone suffices."""
    for step, requires in ((midpoint, ("magnetic",)), (drift_only, ("separable",))):
        assert own_step.OwnStep("mine", step, {}, requires).step is step
    assert own(drift_only).step is not drift_only


def test_a_requirement_that_is_added_counts():
    def step(system, x, v, h):
        return drift_only(system, x, v, h)

    chosen = subject(step, requires=("magnetic",))
    y = problem("magnetic-mirror")
    end = chosen.own.step(own_step.System(y.system), np.array(y.q0), np.array(y.p0), 0.5)
    assert end[0] == pytest.approx([0.5, 0.15, 0.1], abs=1e-15)


# -- the battery ------------------------------------------------------------------------------------------------------


def test_the_battery_of_charged_particles():
    entries = battery.magnetic()
    assert {e.system.d for e in entries} == {2, 3}
    assert {float(magnetic.constants(e.system)[0]) for e in entries} == {1.0, 2.0}
    for e in entries:
        found = magnetic.particle(e.system)
        assert e.system.traits["magnetic"] == "classical"
        assert any(z.free_symbols for z in found.B), "B varies"
        assert any(z.free_symbols for z in found.E), "so does E"
        assert battery.find_entry(e.name) is e
        assert not e.reversible
        turned = {p: -p for p in e.system.p}
        assert sp.expand(e.system.H.subs(turned, simultaneous=True) - e.system.H) != 0
        if e.invariant:
            L = sp.sympify(e.invariant, {str(s): s for s in (*e.system.q, *e.system.p)})
            rate = sum(sp.diff(L, s) * r for s, r in zip(e.system.q, e.system.dq, strict=True))
            rate += sum(sp.diff(L, s) * r for s, r in zip(e.system.p, e.system.dp, strict=True))
            assert sp.expand(rate) == 0
    assert sum(e.lasting for e in entries) == 2


# -- certificates -----------------------------------------------------------------------------------------------------


def judged(step, claims: dict) -> dict:
    """{claim: verdict} from a certificate of these claims alone for a step of charged particles."""
    return verdicts(certificate.certify(step, claims, ("magnetic",), alone=True))


def test_boris_keeps_volume_and_is_not_symplectic():
    """PlasmaPy asks in its issue 3303: that a step keeps volume does not make it symplectic."""
    found = judged(BORIS, {})
    assert set(found.values()) == {HOLDS}
    assert {"order", "symmetric", "volume", "symplectic"} < set(found)
    claimed = judged(BORIS, {"symplectic": True})
    assert claimed.pop("symplectic") == CONTRADICTED
    assert set(claimed.values()) == {HOLDS}


def test_volume_that_is_lost_contradicts():
    found = judged(trapezoid, {"order": 2, "volume": True})
    assert found.pop("volume") == CONTRADICTED
    assert set(found.values()) == {HOLDS}
    assert judged(trapezoid, {"volume": False})["volume"] == HOLDS


def test_a_symplectic_step_is_K_symplectic_and_keeps_volume():
    assert set(judged(midpoint, {"symplectic": True, "volume": True}).values()) == {HOLDS}


def test_a_step_that_leaves_out_the_field_is_no_step_of_the_system():
    assert judged(drift_only, {"volume": True})["consistent"] == CONTRADICTED


def test_volume_may_be_claimed_of_any_step():
    found = certificate.certify(leapfrog, {"volume": True}, ("separable",), alone=True)
    assert verdicts(found)["volume"] == HOLDS


def test_what_changes_its_velocity_in_place_is_found():
    def step(system, x, v, h):
        v += h * (system.E(x) + np.cross(v, system.B(x)))
        return x + h * v, v

    assert judged(step, {})["pure"] == CONTRADICTED
    with pytest.raises(InvalidInput, match="must not change"):
        own_step.integrate_step(problem("magnetic-mirror"), own(step), h=0.1, steps=2)


# -- bad input --------------------------------------------------------------------------------------------------------


def test_a_system_without_a_field_is_refused():
    with pytest.raises(InvalidInput, match=r"requires a system with the trait 'magnetic', which this one lacks"):
        pb.integrate("kepler", BORIS, h=0.1, steps=1)
    with pytest.raises(InvalidInput, match=r"'boris' requires a system with the trait 'magnetic'"):
        pb.integrate("kepler", "boris", h=0.1, steps=1)


def test_a_relativistic_particle_is_refused():
    with pytest.raises(InvalidInput, match="not relativistic, and this one is relativistic"):
        own_step.integrate_step(
            relativistic_particle(), own(trapezoid), h=0.1, steps=1, q0=(0.3, -0.5, 0.4), p0=(0.4, 0.6, -0.3)
        )


def test_an_unknown_trait_suggests_the_nearest(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("REQUIRES = ('magnetics',)\ndef step(system, x, v, h):\n    return x, v\n")
    for call in (lambda: pb.validate(str(file)), lambda: pb.integrate("magnetic-mirror", str(file), h=0.1, steps=1)):
        with pytest.raises(InvalidInput, match=r"magnetics.*did you mean magnetic"):
            call()


def test_fields_without_the_requirement_say_what_is_missing(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("def step(system, x, v, h):\n    return x + h * v, v + h * system.E(x)\n")
    with pytest.raises(InvalidInput, match=r"line 2.*REQUIRES = \('magnetic',\)"):
        pb.integrate("magnetic-mirror", str(file), h=0.1, steps=1)


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        ("x", "must return q, p"),
        ("(x[:2], v)", "shape"),
        ("(x, v, h)", "must return q, p"),
        ("x[:1].reshape(())", "must return q, p"),
    ],
)
def test_what_is_no_state_is_refused(tmp_path, returned, words):
    file = tmp_path / "mine.py"
    file.write_text(f"REQUIRES = 'magnetic'\ndef step(system, x, v, h):\n    return {returned}\n")
    with pytest.raises(InvalidInput, match=words):
        pb.integrate("magnetic-mirror", str(file), h=0.1, steps=1)


def test_the_new_state_may_be_one_array(tmp_path):
    ends = []
    for returned in ("x, v", "np.array([x, v])"):
        file = tmp_path / f"step{len(ends)}.py"
        file.write_text(
            "import numpy as np\nREQUIRES = 'magnetic'\n"
            f"def step(system, x, v, h):\n    x, v = x + h * v, v + h * system.E(x)\n    return {returned}\n"
        )
        ends.append(pb.integrate("magnetic-mirror", str(file), h=0.1, steps=3))
    assert np.array_equal(ends[0].q, ends[1].q)
    assert np.array_equal(ends[0].p, ends[1].p)
