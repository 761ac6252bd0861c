"""The user's own problem, by the path of a file or by a formula; errors are named with their line."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.portfolio import portfolio
from phasebench.benchmarks.problems import file_and_orbit, problem, user
from phasebench.benchmarks.problems.user import from_formula
from phasebench.integrators import integrate
from phasebench.integrators.errors import InvalidInput
from support.commands import call, run_json

STEPS = ("--h", "0.1", "--t-end", "2")
FORMULA = ("--hamiltonian", "p**2/2 - cos(q)", "--q", "2", "--p", "0")
HEAD = "from phasebench.benchmarks.problems.base import Orbit, Problem\n"
HEAD += "from phasebench.integrators import Hamiltonian, PartitionedSystem\n"
GOOD = """
def make(k=1.0):
    print("made")
    H = f"(p1**2 + p2**2)/2 - {k!r}/sqrt(q1**2 + q2**2)"
    return Problem(
        id="mine",
        name="Kepler",
        source="own",
        system=Hamiltonian(q="q1 q2", p="p1 p2", H=H, singular=["sqrt(q1**2 + q2**2)"]),
        orbits=(Orbit("circle", (1, 0), [0, 1]), Orbit("ellipse", (2, 0), (0, 0.9))),
        invariants={"L": "q1*p2 - q2*p1"},
    )
"""
SHORT = 'problem = Problem(id="mine", name="pendulum", source="own",\n'
SHORT += '    system=Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)"), orbits=Orbit("start", 2, 0))\n'


def write_file(folder, text, name="mine.py", head=HEAD) -> str:
    """The path of a file with this text."""
    path = folder / name
    path.write_text(head + text)
    return str(path)


@pytest.mark.parametrize("method", ["stormer-verlet", "heyoka"])
def test_file_and_formula_equal_the_registered_problem(method, tmp_path):
    expected = run_json("pendulum", method, *STEPS)[1]
    for arguments in ((write_file(tmp_path, SHORT), method), ("mine", method, *FORMULA), (method, *FORMULA)):
        code, found = run_json(*arguments, *STEPS)
        assert code == 0
        assert found["problem"] == ("mine" if arguments[0] != method else FORMULA[1])
        for key in ("q", "p", "t", "h", "steps", "energy_error"):
            assert found[key] == expected[key]


def test_file_has_parameters_and_orbits(tmp_path):
    path = write_file(tmp_path, GOOD)
    made = problem(path + ":ellipse", k=2.0)
    assert (made.label, made.q0, made.p0, made.parameters) == ("mine:ellipse", (2.0, 0.0), (0.0, 0.9), {"k": 2.0})
    code, found = run_json(path + ":ellipse", "rk4", *STEPS, "--set", "k=2")
    assert code == 0
    assert found["q"] == integrate(made, "rk4", h=0.1, t_end=2).q[-1].tolist()
    assert found["q"] != run_json(path + ":ellipse", "rk4", *STEPS)[1]["q"]
    assert set(found["invariants"]) == {"L"}


def test_integer_parameter_stays_an_integer(tmp_path):
    """A number from the command line is a double; it becomes an int where the file's default is one."""
    path = write_file(tmp_path, GOOD.replace("def make(", "def make(n=2, ", 1))
    assert problem(path, n=3.0).parameters["n"] == 3
    kinds = [{k: type(v) for k, v in problem(path, n=n, k=2.0).parameters.items()} for n in (3.0, 3.5)]
    assert kinds == [{"n": int, "k": float}, {"n": float, "k": float}]


def test_paths_may_have_dots_and_colons():
    assert file_and_orbit("./a.b.v2.py") == ("./a.b.v2.py", "")
    assert file_and_orbit(r"C:\x\a.py:orbit") == (r"C:\x\a.py", "orbit")


def system(H="p**2/2 - cos(q)", orbit='"start", (1.0,), (0.0,)', more="", extra=""):
    """The text of a file with a problem, from parts of its definition."""
    made = f'Hamiltonian(q="q", p="p", H="{H}"{extra})'
    return f'problem = Problem(id="x", name="x", source="x", system={made}, orbits=(Orbit({orbit}),){more})\n'


BAD = {
    "raises": ("\ndef make():\n    return 1/0\n", ["line 5", "ZeroDivisionError: division by zero"]),
    "own check": ("from phasebench import InvalidInput\nraise InvalidInput('k is 0')\n", ["line 4: k is 0"]),
    "formula": (system(H="p**2/2 - cos(x)"), ["line 3", "'x'"]),
    "no problem": ("def make():\n    return Hamiltonian(q='q', p='p', H='p**2')\n", ["Hamiltonian, no Problem"]),
    "no value": ("def make(k):\n    return k\n", ["--set k=2"]),
    "text value": ("PARAMETERS = {'k': 'one'}\ndef make(k):\n    return k\n", ["k of", "'one'"]),
    "no numbers": (system(orbit='"start", ("a",), (0.0,)'), ["orbit 'start'", "finite"]),
    "length": (system(orbit='"start", (1.0, 2.0), (0.0,)'), ["orbit 'start'", "1 finite"]),
    "energy": (system(H="p**2/2 - 1/q", orbit='"start", (0.0,), (0.0,)'), ["the energy", "singularity"]),
    "field": (system(H="p**2/2 + sqrt(q)", orbit='"start", (0.0,), (1.0,)'), ["dp/dt"]),
    "singular": (system(orbit='"start", (0.0,), (1.0,)', extra=', singular=["q"]'), ["singular", "0.0 at the start"]),
    "invariant": (system(more=', invariants={"J": "q*p"}'), ["'J' is not conserved"]),
    "of the system": (system(extra=', invariants=["q"]'), ["invariant 1 of the system is not conserved"]),
    "constant": (system(more=', invariants={"J": "3"}'), ["constant"]),
    "foreign": ("import sympy\n" + system(more=', invariants={"J": sympy.Symbol("q")}'), ["real=True"]),
    "no energy": (
        'problem = Problem(id="x", name="x", source="x", system=PartitionedSystem(q="q", p="p", dq=["p"], dp=["q"]),'
        ' orbits=(Orbit("start", (1.0,), (0.0,)),))',
        ["energy"],
    ),
}


@pytest.mark.parametrize("which", BAD)
def test_error_in_a_file_is_named(which, tmp_path):
    text, words = BAD[which]
    path = write_file(tmp_path, text)
    code, found = run_json(path, "rk4", *STEPS)
    assert (code, found["status"]) == (2, "invalid")
    for word in (path, *words):
        assert word in found["reason"]


def test_constants_are_exact_doubles():
    code, found = run_json(
        "rk4", "--hamiltonian", "p**2/2 - k*cos(w*q)", *FORMULA[2:], *STEPS, "--set", "k=0.1", "--set", "w=3"
    )
    assert code == 0
    made = user.from_formula("p**2/2 - k*cos(w*q)", [2.0], [0.0], {"k": 0.1, "w": 3.0})
    assert made.system.H == user.from_formula("p**2/2 - 0.1*cos(3*q)", [2.0], [0.0]).system.H
    assert found["q"] == integrate(made, "rk4", h=0.1, t_end=2).q[-1].tolist()


def test_names_of_ones_own_are_those_of_python():
    """x and px in alphabetical order; phi occurs in its momentum alone."""
    texts = "pr**2/2 + pphi**2/(2*r**2) - 1/r", "p2**2/2 + p1**2/(2*q2**2) - 1/q2"
    one, other = (user.from_formula(text, [0.9, 0.8], [0.3, 0.7]) for text in texts)
    runs = [integrate(made, "gauss-4", h=0.1, steps=20) for made in (one, other)]
    assert np.array_equal(runs[0].q, runs[1].q)
    assert [str(x) for x in one.system.p] == [f"p{x}" for x in one.system.q]
    with pytest.raises(InvalidInput, match="y besides the variables x, px"):
        user.from_formula("px**2/2 + x*y", [1.0], [0.0])


def with_invariant(L):
    system = pb.Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + (x**2 + y**2)/2")
    orbit = pb.Orbit("circle", (1.0, 0.0), (0.0, 1.0))
    return pb.Problem(id="mine", name="mine", source="", system=system, orbits=(orbit,), invariants={"L": L})


def test_an_invariant_given_as_text_is_a_formula_of_the_variables():
    s = pb.integrate(with_invariant("(x**2 + u**2)/2"), "stormer-verlet", h=0.1, t_end=1.0)
    assert s.invariants()["L"] == pytest.approx((s.q[:, 0] ** 2 + s.p[:, 0] ** 2) / 2, rel=1e-14)
    for text in ("x*w - y*u", "__import__('os')"):
        with pytest.raises(InvalidInput, match="the invariant 'L': the formula"):
            with_invariant(text)


# -- constraints -------------------------------------------------------------------------------------------------------


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
    good, path = text.replace("Q, P", "(0.6, 0.0, -0.8), (0.0, 1.0, 0.0)"), tmp_path / "bob.py"
    path.write_text(good)
    assert {*pb.problem(str(path)).invariants} == {"L", "constraint 1", "hidden constraint 1"}
    for old, new, said in (("(0.0, 1", "(0.5, 1", "hidden constraint"), ("x*v - y*u", "x*w - z*u", "not conserved")):
        path.write_text(good.replace(old, new))
        with pytest.raises(pb.InvalidInput, match=said):
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
