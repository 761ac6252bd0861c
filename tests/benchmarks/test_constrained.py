"""Constraints as users meet them: the command line, problems, steps of one's own, stability and advice."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.portfolio import portfolio
from phasebench.benchmarks.problems.user import from_formula
from support.commands import call, run_json

H = "(p1**2 + p2**2 + p3**2)/2 + g*q3"
SPHERE = ["--hamiltonian", H, "--set", "g=2", "--constraint", "q1**2 + q2**2 + q3**2 = 1"]
START = ["--q", "0.6,0,-0.8", "--p", "0,1,0"]

RATTLE = """
import numpy as np

CLAIMS = {"order": 2, "symplectic": True, "reversible": True, "constraints": "preserved"}
REQUIRES = ("constrained", "constant mass matrix")


def step(system, q, p, h):
    G = system.G(q)
    V = np.array([system.dH_dp(q, row) for row in G])
    p = p - h / 2 * system.dH_dq(q, p)
    new = q + h * system.dH_dp(q, p)
    for _ in range(20):
        change = np.linalg.solve(system.G(new) @ V.T, system.g(new))
        p, new = p - G.T @ change / h, new - V.T @ change
    p = p - h / 2 * system.dH_dq(new, p)
    G = system.G(new)
    V = np.array([system.dH_dp(new, row) for row in G])
    return new, p - G.T @ np.linalg.solve(G @ V.T, V @ p)
"""
#: Its last line without the projection of p.
LOOSE = RATTLE.replace("return new, p - G.T @ np.linalg.solve(G @ V.T, V @ p)", "return new, p")


def test_integrate_reports_constraints_as_invariants():
    code, found = run_json("rattle", *SPHERE, *START, "--h", "0.05", "--t-end", "10")
    assert (code, found["status"]) == (0, "ok")
    kept = found["invariants"]
    assert set(kept) == {"constraint 1", "hidden constraint 1"}
    assert max(kept[name]["max"] for name in kept) < 1e-14
    _, found = run_json("rk4", *SPHERE, *START, "--h", "0.05", "--t-end", "10")
    assert found["invariants"]["constraint 1"]["max"] > 1e-8


def test_a_start_off_the_constraints_is_answered_with_one_to_paste():
    done = call("integrate", "rattle", *SPHERE, "--q", "0.6,0.1,-0.8", "--p", "0,1,0", "--h", "0.1", "--t-end", "1")
    assert done.exit_code != 0
    near = [word.strip(".") for word in "".join(done.output.split("\n")).split() if word.startswith(("--q=", "--p="))]
    assert len(near) == 2
    assert call("integrate", "rattle", *SPHERE, *near, "--h", "0.1", "--t-end", "1")[0] == 0


def test_a_file_with_constraints_is_checked(tmp_path):
    text = """
from phasebench import ConstrainedHamiltonian, Orbit, Problem

system = ConstrainedHamiltonian(
    q="x y z", p="u v w", H="(u**2 + v**2 + w**2)/2 + z", constraints=["x**2 + y**2 + z**2 = 1"]
)
problem = Problem(
    id="bob", name="a bob", source="mine", system=system, orbits=(Orbit("start", Q, P),), invariants={"L": "x*v - y*u"}
)
"""
    path = tmp_path / "bob.py"
    path.write_text(text.replace("Q, P", "(0.6, 0.0, -0.8), (0.0, 1.0, 0.0)"))
    found = pb.integrate(str(path), "rattle", h=0.05, t_end=5.0)
    assert found.status == "ok"
    assert {name: np.ptp(x) < 1e-13 for name, x in found.invariants().items()} == {
        "L": True,
        "constraint 1": True,
        "hidden constraint 1": True,
    }
    path.write_text(text.replace("Q, P", "(0.6, 0.0, -0.8), (0.5, 1.0, 0.0)"))
    with pytest.raises(pb.InvalidInput, match="hidden constraint"):
        pb.problem(str(path))
    path.write_text(text.replace("Q, P", "(0.6, 0.0, -0.8), (0.0, 1.0, 0.0)").replace("x*v - y*u", "x*w - z*u"))
    with pytest.raises(pb.InvalidInput, match="not conserved"):
        pb.problem(str(path))


def test_a_step_of_ones_own_is_judged_on_the_manifold(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(RATTLE)
    found = pb.validate(str(path))
    verdicts = {claim["claim"]: claim["verdict"] for claim in found.as_dict()["claims"]}
    assert {"order 2", "symplectic", "reversible", "constraints: preserved"} <= set(verdicts)
    assert set(verdicts.values()) == {"holds"}
    path.write_text(LOOSE)
    found = pb.validate(str(path), constraints="preserved")
    verdicts = {claim["claim"]: claim["verdict"] for claim in found.as_dict()["claims"]}
    assert verdicts["constraints: preserved"] == "contradicted"
    assert verdicts["reversible"] == "contradicted"


def test_advice_lets_methods_for_constraints_compete():
    problem = from_formula(H, [0.6, 0.0, -0.8], [0.0, 1.0, 0.0], {"g": 2.0}, constraints=["q1**2 + q2**2 + q3**2 - 1"])
    members, _ = portfolio(ask(problem, t_end=1.0, accuracy=1e-4), 1e-4)
    able = {integrator.id for integrator, _ in members}
    assert {"rattle", "lobatto-iiia-iiib-constrained-6", "dop853", "gauss-4"} <= able
    assert not {"scheme-iv", "avf", "tao-2"} & able
