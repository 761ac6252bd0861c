"""The user's own problem, by the path of a file or by a formula; errors are named with their line."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import file_and_orbit, problem, user
from phasebench.integrators import integrate
from phasebench.integrators.errors import InvalidInput
from support.commands import run_json

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


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("kepler:e", (None, "")),
        ("./a.b.v2.py", ("./a.b.v2.py", "")),
        ("a.py:orbit", ("a.py", "orbit")),
        (r"C:\x\a.py:orbit", (r"C:\x\a.py", "orbit")),
        ("./folder", ("./folder", "")),
    ],
)
def test_paths_and_ids_are_distinguished(name, expected):
    assert file_and_orbit(name) == expected


def system(H="p**2/2 - cos(q)", orbit='"start", (1.0,), (0.0,)', more="", extra=""):
    """The text of a file with a problem, from parts of its definition."""
    made = f'Hamiltonian(q="q", p="p", H="{H}"{extra})'
    return f'problem = Problem(id="x", name="x", source="x", system={made}, orbits=(Orbit({orbit}),){more})\n'


BAD = {
    "syntax": ("def make(:\n", ["line 3", "SyntaxError"]),
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


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("none.py", "there is no file"),
        ("./", "directory"),
        ("./a.txt", "ends in .py"),
        ("mine.py:x", "there is no orbit of 'mine' 'x'; did you mean xx?"),
    ],
)
def test_path_that_is_no_problem_file_is_named(name, word, tmp_path, monkeypatch):
    write_file(tmp_path, GOOD.replace("ellipse", "xx"))
    write_file(tmp_path, "", "a.txt")
    monkeypatch.chdir(tmp_path)
    code, found = run_json(name, "rk4", *STEPS)
    assert code == 2
    assert word in found["reason"]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("pendulum", "rk4", *FORMULA), "both the problem"),
        (("rk5", *FORMULA), "did you mean"),
        (("rk4",), "give a problem and a method"),
        (("rk4", "--hamiltonian", "p**2/2", "--p", "1"), "--q"),
        (("rk4", *FORMULA, "--q", "1,2"), "d = 1"),
        (("rk4", *FORMULA, "--set", "k=2"), "no constant 'k'"),
        (("rk4", *FORMULA, "--set", "q=3"), "variable"),
        (("rk4", "--hamiltonian", "p**2/2 + k*q", "--q", "1", "--p", "1"), "--set k=2"),
        (("rk4", "--hamiltonian", "p**2/2 - 1/q", "--q", "0", "--p", "1"), "singularity"),
        (("rk4", "--hamiltonian", "1 + 1", "--q", "1", "--p", "1"), "no variable"),
        (("rk4", "--hamiltonian", "p1**2 + q3", "--q", "1,1,1", "--p", "1,1,1"), "neither q2 nor p2"),
        (("rk4", "--hamiltonian", "__import__('os').system('x')", "--q", "1", "--p", "1"), "stands in no formula"),
    ],
)
def test_error_in_a_formula_is_named(arguments, word):
    code, found = run_json(*arguments, *STEPS)
    assert (code, found["status"]) == (2, "invalid")
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
