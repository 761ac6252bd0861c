"""Steps of one's own of a charged particle, step(system, x, v, h): seen as steps of (q, p), certified, refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.certificate import certificate
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS
from phasebench.benchmarks.measure import own_step
from phasebench.benchmarks.measure.battery import relativistic_particle
from phasebench.benchmarks.problems import problem
from phasebench.integrators.errors import InvalidInput
from support.evidence import verdicts

BORIS = str(Path(__file__).parents[2] / "examples" / "boris.py")


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


def in_place(system, x, v, h):
    v += h * (system.E(x) + np.cross(v, system.B(x)))
    return x + h * v, v


def own(step, *requires) -> own_step.OwnStep:
    return own_step.OwnStep(step.__name__, step, {}, requires or ("magnetic",))


@pytest.mark.parametrize(
    ("name", "velocity", "E", "B"),
    [
        ("charged-particle", [0.1, 0.01, 0.0], [0.0, -0.01, 0.0], [0.0, 0.0, 1.0]),
        ("magnetic-mirror", [0.0, 0.3, 0.2], [0.0, 0.0, 0.0], None),
    ],
)
def test_the_fields_are_those_of_the_particle_in_three_components(name, velocity, E, B):
    whole = problem(name)
    seen = own_step.System(whole.system).particle
    x, v = seen.state(np.array(whole.q0), np.array(whole.p0))
    assert v == pytest.approx(velocity, abs=1e-16)
    assert seen.E(x) == pytest.approx(E, abs=1e-17)
    if B is not None:
        assert seen.B(x).tolist() == B
    else:
        assert seen.B([1.0, 2.0, 5.0]) == pytest.approx([-0.05, -0.1, 1.25], rel=1e-15)
    assert seen.evaluations == [1, 1]
    assert seen.momentum(x, v) == pytest.approx(whole.p0, abs=1e-16)
    assert seen.H(x, v) == pytest.approx(whole.system.energies([whole.q0], [whole.p0])[0], rel=1e-15)


def test_a_step_of_ones_own_is_the_method():
    mine, its, other = (pb.integrate("magnetic-mirror", m, h=0.1, t_end=20) for m in (BORIS, "boris", "he-splitting-2"))
    assert mine.status == "ok"
    assert max(np.abs(mine.q - its.q).max(), np.abs(mine.p - its.p).max()) < 1e-12
    assert np.abs(mine.q - other.q).max() > 1e-4
    assert mine.counts["gradient"] == its.counts["gradient"] == 200


def test_a_step_is_one_of_x_and_v_if_it_names_them_and_requires_a_field():
    for step, requires in ((midpoint, ("magnetic",)), (drift_only, ("separable",))):
        assert own_step.OwnStep("mine", step, {}, requires).step is step
    chosen = subject(drift_only, requires=("magnetic",))
    y = problem("magnetic-mirror")
    end = chosen.own.step(own_step.System(y.system), np.array(y.q0), np.array(y.p0), 0.5)
    assert end[0] == pytest.approx([0.5, 0.15, 0.1], abs=1e-15)


@pytest.mark.parametrize(
    ("step", "claims", "contradicted"),
    [
        (BORIS, {}, set()),
        (BORIS, {"symplectic": True}, {"symplectic"}),  # that a step keeps volume does not make it symplectic
        (trapezoid, {"order": 2, "volume": True}, {"volume"}),
        (trapezoid, {"volume": False}, set()),
        (midpoint, {"symplectic": True, "volume": True}, set()),
        (drift_only, {"volume": True}, {"consistent"}),
        (in_place, {}, {"pure"}),
    ],
)
def test_certificates_of_steps_of_charged_particles(step, claims, contradicted):
    found = verdicts(certificate.certify(step, claims, ("magnetic",), alone=True))
    assert {name for name, verdict in found.items() if verdict == CONTRADICTED} == contradicted
    assert contradicted & {"consistent", "pure"} or {v for k, v in found.items() if k not in contradicted} == {HOLDS}
    assert step is not BORIS or {"order", "symmetric", "volume"} < {*found}


STEP = "def step(system, x, v, h):\n    return x, v\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("REQUIRES = ('magnetics',)\n" + STEP, r"magnetics.*did you mean magnetic"),
        (STEP.replace("x, v\n", "x, system.E(x)\n"), r"line 2.*REQUIRES = \('magnetic',\)"),
        ("REQUIRES = 'magnetic'\n" + STEP.replace("x, v\n", "x\n"), "must return q, p"),
        ("REQUIRES = 'magnetic'\n" + STEP.replace("x, v\n", "x[:2], v\n"), "shape"),
    ],
)
def test_a_wrong_file_gets_its_error(tmp_path, text, said):
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(InvalidInput, match=said):
        pb.integrate("magnetic-mirror", str(file), h=0.1, steps=1)


def test_systems_without_such_a_field_are_refused():
    with pytest.raises(InvalidInput, match=r"requires a system with the trait 'magnetic', which this one lacks"):
        pb.integrate("kepler", BORIS, h=0.1, steps=1)
    with pytest.raises(InvalidInput, match="must not change"):
        own_step.integrate_step(problem("magnetic-mirror"), own(in_place), h=0.1, steps=2)
    start = {"q0": (0.3, -0.5, 0.4), "p0": (0.4, 0.6, -0.3)}
    with pytest.raises(InvalidInput, match="not relativistic, and this one is relativistic"):
        own_step.integrate_step(relativistic_particle(), own(trapezoid), h=0.1, steps=1, **start)
