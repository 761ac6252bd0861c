"""The user's own problem, by the path of a file or by a formula; errors are named with their line."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from phasebench.benchmarks.problems import file_and_orbit, problem, user, user_file
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.errors import InvalidInput
from support.commands import run_json

ROOT = Path(__file__).resolve().parents[2]
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


@pytest.mark.parametrize("method", ["stormer-verlet", "heyoka", "scipy-dop853"])
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


def test_file_whose_name_has_the_characters_of_a_formula(tmp_path):
    path = write_file(tmp_path, GOOD, name="mine (1)+2.py")
    assert problem(path).id == problem(path + ":ellipse").id == "mine"
    with pytest.raises(InvalidInput, match="a formula is given by --hamiltonian"):
        problem("mine*(1) + 2")


def test_integer_parameter_stays_an_integer(tmp_path):
    """A number from the command line is a double; it becomes an int where the file's default is one."""
    path = write_file(tmp_path, GOOD.replace("def make(", "def make(n=2, ", 1))
    assert problem(path, n=3.0).parameters["n"] == 3
    kinds = [{k: type(v) for k, v in problem(path, n=n, k=2.0).parameters.items()} for n in (3.0, 3.5)]
    assert kinds == [{"n": int, "k": float}, {"n": float, "k": float}]


def test_copy_of_a_registered_problem_keeps_its_path(tmp_path, monkeypatch):
    text = (ROOT / "benchmarks" / "problems" / "kepler.py").read_text()
    write_file(tmp_path, text, "kepler.py", head="")
    monkeypatch.chdir(tmp_path)
    code, found = run_json("kepler.py", "rk4", *STEPS, "--set", "e=0.2")
    assert (code, found["problem"]) == (0, "kepler.py")
    assert found["q"] == run_json("kepler", "rk4", *STEPS, "--set", "e=0.2")[1]["q"]
    assert problem("kepler").label == "kepler"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("kepler", (None, "")),
        ("kepler:e", (None, "")),
        ("./a.b.v2.py", ("./a.b.v2.py", "")),
        ("a.py:orbit", ("a.py", "orbit")),
        (r"C:\x\a.PY", (r"C:\x\a.PY", "")),
        (r"C:\x\a.py:orbit", (r"C:\x\a.py", "orbit")),
        ("./folder", ("./folder", "")),
        ("./a.py:folder/b.py", ("./a.py:folder/b.py", "")),
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
    "null": ("x = '\0'\n", ["SyntaxError"]),
    "raises": ("\ndef make():\n    return 1/0\n", ["line 5", "ZeroDivisionError: division by zero"]),
    "exits": ("raise SystemExit(3)\n", ["line 3", "SystemExit"]),
    "imports": ("import no_such_module\n", ["line 3", "ModuleNotFoundError"]),
    "own check": ("from phasebench import InvalidInput\nraise InvalidInput('k is 0')\n", ["line 4: k is 0"]),
    "formula": (system(H="p**2/2 - cos(x)"), ["line 3", "'x'"]),
    "nothing": ("x = 1\n", ["no function 'make'"]),
    "no function": ("make = 3\n", ["make is a int"]),
    "no problem": ("def make():\n    return Hamiltonian(q='q', p='p', H='p**2')\n", ["Hamiltonian, no Problem"]),
    "no value": ("def make(k):\n    return k\n", ["--set k=2"]),
    "text value": ("PARAMETERS = {'k': 'one'}\ndef make(k):\n    return k\n", ["k of", "'one'"]),
    "no numbers": (system(orbit='"start", ("a",), (0.0,)'), ["orbit 'start'", "finite"]),
    "not finite": (system(orbit='"start", (float("nan"),), (0.0,)'), ["orbit 'start'", "finite"]),
    "length": (system(orbit='"start", (1.0, 2.0), (0.0,)'), ["orbit 'start'", "1 finite"]),
    "energy": (system(H="p**2/2 - 1/q", orbit='"start", (0.0,), (0.0,)'), ["the energy", "singularity"]),
    "field": (system(H="p**2/2 + sqrt(q)", orbit='"start", (0.0,), (1.0,)'), ["dp/dt"]),
    "singular": (system(orbit='"start", (0.0,), (1.0,)', extra=', singular=["q"]'), ["singular", "0.0 at the start"]),
    "invariant": (system(more=', invariants={"J": "q*p"}'), ["'J' is not conserved"]),
    "hidden": (system(H="p**2/2", more=', invariants={"J": "q"}'), ["'J' is not conserved", "p = "]),
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


def test_control_conserved_invariant_is_accepted(tmp_path):
    code, found = run_json(write_file(tmp_path, system(more=', invariants={"J": "p**2 - 2*cos(q)"}')), "rk4", *STEPS)
    assert code == 0
    assert found["invariants"]["J"]["max"] == pytest.approx(2 * found["energy_error"]["max"], rel=1e-6)


def test_exception_in_user_code_is_the_cause(tmp_path):
    with pytest.raises(InvalidInput) as caught:
        problem(write_file(tmp_path, BAD["raises"][0]))
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


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
        (("pendulum", *FORMULA), "both the problem"),
        (("mine.py", "rk4", *FORMULA), "both the problem"),
        (("rk5", *FORMULA), "did you mean"),
        (("rk4",), "give a problem and a method"),
        (("rk4", "--hamiltonian", "p**2/2", "--p", "1"), "--q"),
        (("rk4", "--hamiltonian", "p**2/2", "--q", "1"), "--p"),
        (("rk4", *FORMULA, "--q", "1,2"), "d = 1"),
        (("rk4", *FORMULA, "--q", "inf"), "finite"),
        (("rk4", *FORMULA, "--set", "k=2"), "no constant 'k'"),
        (("rk4", *FORMULA, "--set", "pi=3"), "no constant 'pi'"),
        (("rk4", *FORMULA, "--set", "q=3"), "variable"),
        (("rk4", "--hamiltonian", "p**2/2 + k*q", "--q", "1", "--p", "1"), "--set k=2"),
        (("rk4", "--hamiltonian", "p**2/2 - 1/q", "--q", "0", "--p", "1"), "singularity"),
        (("rk4", "--hamiltonian", "sqrt(q)", "--q", "-1", "--p", "1"), "domain"),
        (("rk4", "--hamiltonian", "1 + 1", "--q", "1", "--p", "1"), "no variable"),
        (("rk4", "--hamiltonian", "p1**2 + q3", "--q", "1,1,1", "--p", "1,1,1"), "neither q2 nor p2"),
        (("rk4", "--hamiltonian", "p1**2 + q", "--q", "1", "--p", "1"), "numbered"),
        (("rk4", "--hamiltonian", "__import__('os').system('x')", "--q", "1", "--p", "1"), "stands in no formula"),
        (("heyoka", *FORMULA, "--time-limit", "1"), "--time-limit"),
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


@pytest.mark.parametrize(
    ("own", "numbered"),
    [
        ("(px**2 + py**2)/2 - 1/sqrt(x**2 + y**2)", "(p1**2 + p2**2)/2 - 1/sqrt(q1**2 + q2**2)"),
        ("pr**2/2 + pphi**2/(2*r**2) - 1/r", "p2**2/2 + p1**2/(2*q2**2) - 1/q2"),
        ("ptheta**2/2 - k*cos(theta)", "p1**2/2 - k*cos(q1)"),
    ],
)
def test_names_of_ones_own_are_those_of_python(own, numbered):
    """x and px in alphabetical order; phi occurs in its momentum alone."""
    k = {"k": 2.0} if "k" in own else {}
    d = 1 if k else 2
    q0, p0 = [0.9, 0.8][:d], [0.3, 0.7][:d]
    one, other = (user.from_formula(text, q0, p0, k) for text in (own, numbered))
    runs = [integrate(made, "gauss-4", h=0.1, steps=20) for made in (one, other)]
    assert np.array_equal(runs[0].q, runs[1].q)
    assert [str(x) for x in one.system.p] == [f"p{x}" for x in one.system.q]


def test_a_constant_is_no_momentum():
    with pytest.raises(InvalidInput, match="y besides the variables x, px"):
        user.from_formula("px**2/2 + x*y", [1.0], [0.0])
    with pytest.raises(InvalidInput, match="d = 2: ot, x, pot, px"):
        user.from_formula("px**2/2 + pot*x", [1.0], [0.0])
    assert user.from_formula("px**2/2 + pot*x", [1.0], [0.0], {"pot": 2.0}).system.d == 1


def test_two_degrees_of_freedom():
    H = "(p1**2 + p2**2)/2 + (q1**2 + q2**2 + 2*q1**2*q2 - 2*q2**3/3)/2"
    made = problem("henon-heiles:box")
    expected = integrate(made, "stormer-verlet", h=0.1, t_end=2).q[-1]
    q, p = (",".join(map(repr, x)) for x in (made.q0, made.p0))
    code, found = run_json("stormer-verlet", "--hamiltonian", H, "--q", q, "--p", p, *STEPS)
    assert code == 0
    assert found["q"] == pytest.approx(expected.tolist(), rel=1e-13)


@pytest.mark.parametrize("H", [lambda q, p: p**2 / 2, object(), None, [1, 2]])
def test_invalid_formula_is_refused(H):
    with pytest.raises(InvalidInput, match="give a SymPy expression"):
        Hamiltonian(q="q", p="p", H=H)


def test_file_is_one_module_until_its_text_changes(tmp_path):
    """What an earlier load defined can be pickled after a later one."""
    path = tmp_path / "mine.py"
    path.write_text("def f(x):\n    return x\n")
    first, second = (user_file.load(str(path)) for _ in range(2))
    assert second is first
    path.write_text("def f(x):\n    return 2 * x\n")
    changed = user_file.load(str(path))
    assert (pickle.loads(pickle.dumps(first.f))(3), pickle.loads(pickle.dumps(changed.f))(3)) == (3, 6)


def test_file_that_raises_is_not_kept(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("import os\nif 'MINE' not in os.environ:\n    raise ValueError('no MINE')\nk = 3\n")
    with pytest.raises(InvalidInput, match=r"line 3: ValueError: no MINE"):
        user_file.load(str(path))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINE", "1")
        assert user_file.load(str(path)).k == 3
