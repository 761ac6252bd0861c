"""``integrate`` with ``--error``, ``--quantity``, ``--output``; ``workprecision`` and ``run`` on the user's problem."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.cli import trajectory
from phasebench.benchmarks.measure import global_error
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from phasebench.reference.certificates import stored
from support.commands import call, integrate_json

RUN = ("henon-heiles:box", "rk4", "--h", "0.1", "--t-end", "10")


def test_error_is_against_the_certified_state():
    end = stored.end(problem("henon-heiles:box"), 10.0)
    s = integrate(problem("henon-heiles:box"), "rk4", h=0.1, t_end=10)
    expected = max(np.abs(s.q[-1] - end.q).max(), np.abs(s.p[-1] - end.p).max())
    found = integrate_json(*RUN, "--error")
    assert found["global_error"] == pytest.approx(expected, rel=1e-9)
    assert found["reference"]["source"] == "certified"
    assert found["reference"]["uncertainty"] < 1e-15
    assert found["reference"]["horizon"] == 10.0


def test_new_reference_where_none_is_stored():
    found = integrate_json("pendulum", "rk4", "--h", "0.1", "--t-end", "3.3", "--error")
    exact = integrate_json("pendulum", "gauss-8", "--h", "0.1", "--t-end", "3.3")
    mine = integrate_json("pendulum", "rk4", "--h", "0.1", "--t-end", "3.3")
    assert found["global_error"] == pytest.approx(max(abs(mine[x][0] - exact[x][0]) for x in "qp"), rel=1e-6)
    assert found["reference"]["source"] == "long double"


def test_reference_of_more_than_a_percent_of_the_state_is_too_vague():
    said = [global_error.vague(Truth(np.array([1.0, -2.0]), known, "a law")) for known in (0.019, 0.021)]
    assert [bool(why) for why in said] == [False, True]


def test_other_initial_state_has_another_reference():
    found = integrate_json("kepler", "gauss-8", "--h", "0.02", "--t-end", "10", "--q", "1,0", "--p", "0,1.1", "--error")
    assert found["global_error"] < 1e-12
    assert found["reference"]["source"] == "long double"


def test_very_long_formula():
    H = "p**2/2 + q**2/2" + " + 0*q" * 60
    found = integrate_json("rk4", "--hamiltonian", H, "--q", "1", "--p", "0", "--h", "0.1", "--t-end", "1", "--error")
    assert 0 < found["global_error"] < 1e-5


def test_decimal_that_makes_integers_beyond_64_bits():
    H = "p**2/2 - 1/sqrt(q**2 + 0.1)"
    found = integrate_json(
        "rk4-relaxation", "--hamiltonian", H, "--q", "1", "--p", "0", "--h", "0.01", "--t-end", "1", "--error"
    )
    assert found["global_error"] < 1e-7


def test_unpredictable_orbit_has_no_error():
    found = integrate_json("henon-heiles:chaotic", "rk4", "--h", "0.1", "--t-end", "1000", "--error")
    assert found["global_error"] is None
    assert "cannot be followed" in found["reference"]["reason"]
    assert found["reference"]["horizon"] < 1000
    code, text, _ = call("integrate", "henon-heiles:chaotic", "rk4", "--h", "0.1", "--t-end", "1000", "--error")
    assert code == 0
    assert "none: the orbit" in text


@pytest.mark.parametrize(("name", "t"), [("schwarzschild:photon-sphere", "36"), ("henon-heiles:chaotic", "300")])
def test_error_past_the_horizon_is_given_where_the_reference_resolves_it(name, t):
    run = (name, "gauss-8", "--steps", "2000", "--error", "--quantity", "trajectory")
    late = integrate_json(*run, "--t-end", t)
    assert late["reference"]["horizon"] < float(t)
    assert late["global_error"] > 4 * late["reference"]["uncertainty"]
    energy = integrate_json(*run[:-1], "energy", "--t-end", t)
    assert energy["quantity_error"]["error"] < 1e-10, "the energy has no horizon"
    assert energy["global_error"] is None, "no reference is computed beside a conserved quantity"


@pytest.mark.parametrize(("uncertainty", "horizon", "told"), [(0.2, 1, True), (0.3, 1, False), (0.009, 10, True)])
def test_errors_that_are_told(monkeypatch, uncertainty, horizon, told):
    """An error of 1 to t = 10: of uncertainty at most a quarter of it, or before the horizon."""
    made = problem("harmonic-oscillator")
    truth = Truth(np.array([1.0, 0.0]), uncertainty, "a law")
    monkeypatch.setattr(global_error.truths, "truth", lambda *of: truth)
    monkeypatch.setattr(global_error, "orbit_horizon", lambda *of: float(horizon))
    rows = SimpleNamespace(t=np.array([0.0, 10.0]), q=np.array([[0.0], [0.0]]), p=np.array([[1.0], [0.0]]))
    found = global_error.end_error(made, rows, 10.0)
    assert found["global_error"] == (1.0 if told else None)
    assert ("reason" in found["reference"]) != told


@pytest.mark.parametrize("name", ["end-state", "trajectory"])
def test_error_back_in_time(name):
    run = ("pendulum", "rk4", "--steps", "100", "--quantity", name, "--p", "0")
    forward, back = (integrate_json(*run, f"--t-end={t}")["quantity_error"]["error"] for t in (10, -10))
    assert back == pytest.approx(forward, rel=1e-9), "at rest at the start, both ways are alike"
    moving = [integrate_json(*run[:-1], "1", f"--t-end={t}")["quantity_error"]["error"] for t in (10, -10)]
    assert moving[0] != pytest.approx(moving[1], rel=0.1), "control"


def test_energy_errors_are_absolute_and_relative():
    found = integrate_json("pendulum", "rk4", "--h", "0.1", "--t-end", "10")
    start = integrate_json("pendulum", "rk4", "--h", "0.1", "--steps", "1")
    made = problem("pendulum")
    H0 = float(made.system.energies(np.array([made.q0]), np.array([made.p0]))[0])
    for key in ("max", "end"):
        assert found["relative_energy_error"][key] == pytest.approx(found["energy_error"][key] / abs(H0), rel=1e-14)
    assert start["relative_energy_error"]["max"] < found["relative_energy_error"]["max"]
    nothing = integrate_json(
        "rk4", "--hamiltonian", "p**2/2 + q**3/3", "--q", "0", "--p", "0", "--h", "0.1", "--t-end", "1"
    )
    assert nothing["relative_energy_error"] == {"max": None, "end": None}, "H0 = 0"


def test_uncertainty_of_the_photon_sphere_reference():
    """The reference is off by 1.6e-10 at t = 36, where the first steps of both its runs round alike."""
    found = integrate_json("schwarzschild:photon-sphere", "gauss-8", "--steps", "200", "--t-end", "36", "--error")
    assert 1.6e-10 < found["reference"]["uncertainty"] < 1e-7


def test_error_of_a_quantity_is_added():
    found = integrate_json(*RUN, "--error", "--quantity", "trajectory")["quantity_error"]
    assert found["quantity"] == "trajectory"
    assert found["error"] >= integrate_json(*RUN, "--error")["global_error"] * 0.999
    energy = integrate_json(*RUN, "--quantity", "energy")
    assert "global_error" in energy
    assert 0 < energy["quantity_error"]["error"] < 1e-3


@pytest.mark.parametrize("name", ["rows.csv", "rows.npz"])
def test_trajectory_is_written(tmp_path, name):
    path = tmp_path / name
    s = integrate(problem("henon-heiles:box"), "rk4", h=0.1, t_end=10)
    found = integrate_json(*RUN, "--output", str(path), "--every", "7")
    rows = [*range(0, 100, 7), 100]
    assert found["output"] == {"file": str(path), "rows": len(rows)}
    if name.endswith("npz"):
        with np.load(path) as whole:
            t, q, p = whole["t"], whole["q"], whole["p"]
    else:
        assert path.read_text().splitlines()[0] == "t,q1,q2,p1,p2"
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        t, q, p = table[:, 0], table[:, 1:3], table[:, 3:]
    assert np.array_equal(t, s.t[rows])
    assert np.array_equal(q, s.q[rows])
    assert np.array_equal(p, s.p[rows])
    assert list(tmp_path.iterdir()) == [path]


def test_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "rows.csv"
    path.write_text("before")

    def full(*of):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    code, _, said = call("integrate", *RUN, "--output", str(path))
    assert code == 2
    assert "No space left" in said
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--output", "rows.txt"], "says its kind: .csv or .npz"),
        (["--output", "/nowhere/at/all/rows.csv"], "there is no folder"),
        (["--every", "3"], "--every says which rows"),
        (["--output", "rows.csv", "--every", "0"], "--every is 0"),
        (["--error", "--quantity", "trajektory"], "trajectory"),
        (["--quantity", "trajectory", "--steps", "33"], "40 is the nearest"),
    ],
)
def test_invalid_output_and_quantity_options(arguments, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    options = RUN if "--steps" not in arguments else (*RUN[:2], "--t-end", "10")
    code, text, said = call("integrate", *options, *arguments)
    assert code == 2
    assert message in text + said
    assert not list(tmp_path.iterdir())


def test_last_row_is_kept(tmp_path):
    path, rows = tmp_path / "a.csv", SimpleNamespace(t=np.arange(5.0), q=np.zeros((5, 1)), p=np.zeros((5, 1)))
    assert trajectory.write(path, rows, 3) == 3
    assert [line.split(",")[0] for line in path.read_text().splitlines()] == ["t", "0.0", "3.0", "4.0"]


# -- work-precision on the user's problem ----------------------------------------------------------------------------

MINE = """
from phasebench import Hamiltonian
from phasebench.benchmarks.problems.base import Orbit, Problem

problem = Problem(
    id="quartic", name="quartic oscillator", source="mine",
    system=Hamiltonian(q="q", p="p", H="p**2/2 + q**4/4"), orbits=(Orbit("start", (1.0,), (0.0,)),),
)
"""


@pytest.fixture
def mine(tmp_path):
    """The path of a file with the problem `MINE`."""
    path = tmp_path / "mine.py"
    path.write_text(MINE)
    return path


def test_work_precision_of_a_user_problem(mine, tmp_path):
    figure = tmp_path / "figure.png"
    options = ["workprecision", mine, "--t-end", "10", "--method", "pefrl", "--method", "heyoka"]
    done = call(*options, "--output", figure, "--json")
    assert done.exit_code == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    assert {r["method"] for r in rows} == {"pefrl", "heyoka"}
    assert figure.read_bytes().startswith(b"\x89PNG")
    errors = [r["error"] for r in rows if r["method"] == "pefrl" and r["status"] == "ok"]
    assert errors[0] > 1e-2
    assert min(errors) < 1e-11
    assert "1e-09" in call(*options).stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["workprecision", "pendulum"], "--t-end"),
        (["workprecision", "pendulum", "--t-end", "1", "--output", "a.txt"], "says its kind: .png, .svg or .pdf"),
        (["workprecision", "pendulum", "--t-end", "1", "--method", "wisdom-holman"], "trait"),
        (["run", "pendulum"], "t_end is None; it must be a positive number"),
        (["run", "pendulum", "--t-end", "1", "--scene", "kepler-t1"], "leave out one"),
    ],
)
def test_invalid_measurement_is_refused(arguments, message):
    done = call(*arguments)
    assert done.exit_code == 2
    assert message in done.stderr


def test_run_on_a_problem_writes_its_rows(mine, tmp_path):
    path = tmp_path / "rows.jsonl"
    done = call("run", mine, "--t-end", "5", "--method", "pefrl", "--output", path)
    assert done.exit_code == 0, done.stderr
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert {r["method"] for r in rows} == {"pefrl"}
    assert len(rows) > 8
