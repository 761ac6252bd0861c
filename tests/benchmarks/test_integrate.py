"""`integrate`: what is seen at every step, its seconds, errors and references, rows written; `workprecision`, `run`."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import every_step, global_error
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.workprecision import WorkPrecision, improving
from phasebench.integrators import integrate
from phasebench.reference.certificates import stored
from phasebench.reference.peers import integrate_peer
from support.commands import call, integrate_json, run_json
from support.steps import leapfrog

# -- what is seen at every step ----------------------------------------------------------------------------------------

BOX = "henon-heiles:box"


def watch(name: str, method, h: float, steps: int, every=None) -> every_step.WatchedRun:
    nothing = {"t_end": None, "q0": None, "p0": None}
    return every_step.watch(problem(name), integrator(method), h=h, steps=steps, every=every, **nothing)


@pytest.mark.parametrize(
    ("name", "method", "h", "steps", "every"),
    [
        (BOX, "stormer-verlet", 0.1, 1003, None),
        ("kepler", "scheme-v", 0.05, 1003, 1),
        (BOX, "rk4", 2.0, 503, 7),  # it blows up
        ("henon-heiles:chaotic", "implicit-midpoint", 3.0, 503, None),  # the solver fails
        ("kepler", "rebound-leapfrog", 0.01, 300, None),
        (BOX, leapfrog, 0.1, 203, 7),
        ("harmonic-oscillator", "stormer-verlet", 1.999, 1001, None),  # the error is small at the rows that are kept
    ],
)
def test_rows_and_extremes_equal_those_of_a_full_run(monkeypatch, name, method, h, steps, every):
    monkeypatch.setattr(every_step, "BUFFER", 154)  # a run fills it many times
    monkeypatch.setattr(every_step, "KEPT", 2)
    made = problem(name)
    if method == "rebound-leapfrog":
        whole = integrate_peer(made, method, h=h, steps=steps)
    else:
        whole = integrate(made, "stormer-verlet" if method is leapfrog else method, h=h, steps=steps)
    found = watch(name, method, h, steps, every)
    s, H = found.solution, made.system.energies(whole.q, whole.p)
    assert (s.status, s.counts["steps"]) == (whole.status, whole.counts["steps"])
    near = {"rel": 1e-6, "abs": 1e-12} if method is leapfrog else {"rel": 0, "abs": 0}
    rows = np.searchsorted(whole.t, s.t)
    assert (rows[0], rows[-1]) == (0, len(whole.t) - 1)
    assert every is None or rows.tolist() == sorted({*range(0, len(whole.t), every), len(whole.t) - 1})
    assert np.array_equal(s.t, whole.t[rows])
    assert s.q == pytest.approx(whole.q[rows], **near)
    assert s.p == pytest.approx(whole.p[rows], **near)
    assert found.extremes.energy.worst == pytest.approx(np.abs(H - H[0]).max(), **near)
    assert found.extremes.energy.end == pytest.approx(H[-1] - H[0], **near)
    for invariant, extreme in found.extremes.invariants.items():
        values = made.invariant(invariant, whole.q, whole.p)
        assert extreme.worst == pytest.approx(np.abs(values - values[0]).max(), **near)


def test_long_run_ends_at_the_time_limit():
    run = (BOX, "stormer-verlet", "--h", "0.001", "--steps", "10000000000")
    _, found = run_json(*run, "--time-limit", "0.3")
    assert (found["status"], found["steps"] > 1000) == ("timeout", True)
    assert found["t"] == pytest.approx(0.001 * found["steps"])
    assert 0 < found["energy_error"]["max"] < 1e-8
    assert call("integrate", *run, "--every", "1", "--output", "a.csv").exit_code == 2, "too many rows"


@pytest.mark.parametrize("steps", [50, 20_000])
def test_seconds_exclude_the_observation(monkeypatch, steps):
    """1000 steps take 1 s bare and 3 s observed; a short run is repeated bare, of a long one short parts are."""
    made, watched, run = [], every_step.watch, Integrator.run

    def watching(problem, integrator, **options):
        found = watched(problem, integrator, **options)
        made.append(("watched", found.solution.counts["steps"]))
        return found._replace(solution=replace(found.solution, seconds=3e-3 * found.solution.counts["steps"]))

    def bare(self, problem, **options):
        found = run(self, problem, **options)
        if options.get("save_every", 1):
            return found
        made.append(("bare", found.counts["steps"]))
        return replace(found, seconds=1e-3 * found.counts["steps"])

    monkeypatch.setattr(every_step, "watch", watching)
    monkeypatch.setattr(Integrator, "run", bare)
    found = integrate_json(BOX, "pefrl", "--h", "0.1", "--steps", steps)
    assert found["seconds"] == pytest.approx(1e-3 * steps)
    assert made[0] == ("watched", steps)
    assert {kind for kind, _ in made[1:]} == ({"bare"} if steps == 50 else {"watched", "bare"})
    assert sum(n for _, n in made[1:]) <= max(50, 0.1 * steps)


# -- errors and references ---------------------------------------------------------------------------------------------

RUN = (BOX, "rk4", "--h", "0.1", "--t-end", "10")


@pytest.mark.parametrize("method", ["rk4", "gauss-4", "rebound-leapfrog"])
def test_error_is_that_of_the_printed_state_against_the_certified_one(method):
    end = stored.end(problem(BOX), 10.0)
    found = integrate_json(BOX, method, "--h", "0.1", "--t-end", "10", "--error")
    off = max(np.abs(np.array(found["q"]) - end.q).max(), np.abs(np.array(found["p"]) - end.p).max())
    assert found["global_error"] == off > 0
    assert (found["reference"]["source"], found["reference"]["horizon"]) == ("certified", 10.0)
    assert found["reference"]["uncertainty"] < 1e-15


FORMULA = ("--q", "1", "--p", "0", "--h", "0.01", "--t-end", "1")


@pytest.mark.parametrize(
    ("words", "largest"),
    [
        (("pendulum", "gauss-8", "--h", "0.1", "--t-end", "3.3"), 1e-12),  # none is stored
        (("kepler", "gauss-8", "--h", "0.02", "--t-end", "10", "--q", "1,0", "--p", "0,1.1"), 1e-12),
        (("rk4", "--hamiltonian", "p**2/2 + q**2/2" + " + 0*q" * 60, *FORMULA), 1e-9),  # a very long formula
        (("rk4-relaxation", "--hamiltonian", "p**2/2 - 1/sqrt(q**2 + 0.1)", *FORMULA), 1e-7),  # integers of 64 bits
    ],
)
def test_new_reference_where_none_is_stored(words, largest):
    found = integrate_json(*words, "--error")
    assert 0 <= found["global_error"] < largest
    assert found["reference"]["source"] == "long double"


@pytest.mark.parametrize(("name", "t"), [("schwarzschild:photon-sphere", "36"), ("henon-heiles:chaotic", "300")])
def test_error_past_the_horizon_is_given_where_the_reference_resolves_it(name, t):
    run = (name, "gauss-8", "--steps", "2000", "--t-end", t, "--error", "--quantity")
    late = integrate_json(*run, "trajectory")
    assert late["reference"]["horizon"] < float(t)
    assert late["global_error"] > 4 * late["reference"]["uncertainty"]
    # The reference of the photon sphere is off by 1.6e-10, where the first steps of both its runs round alike.
    assert name == "henon-heiles:chaotic" or 1.6e-10 < late["reference"]["uncertainty"] < 1e-7
    energy = integrate_json(*run, "energy")
    assert energy["quantity_error"]["error"] < 1e-10, "the energy has no horizon"
    assert energy["global_error"] is None, "no reference is computed beside a conserved quantity"


@pytest.mark.parametrize(("uncertainty", "horizon", "told"), [(0.2, 1, True), (0.3, 1, False), (0.009, 10, True)])
def test_errors_that_are_told(monkeypatch, uncertainty, horizon, told):
    """An error of 1 to t = 10: of uncertainty at most a quarter of it, or before the horizon."""
    truth = Truth(np.array([1.0, 0.0]), uncertainty, "a law")
    monkeypatch.setattr(global_error.truths, "truth", lambda *of: truth)
    monkeypatch.setattr(global_error, "orbit_horizon", lambda *of: float(horizon))
    rows = SimpleNamespace(t=np.array([0.0, 10.0]), q=np.array([[0.0], [0.0]]), p=np.array([[1.0], [0.0]]))
    found = global_error.end_error(problem("harmonic-oscillator"), rows, 10.0)
    assert found["global_error"] == (1.0 if told else None)
    assert ("cannot be followed" in found["reference"].get("reason", "")) != told
    vague = [global_error.vague(Truth(np.array([1.0, -2.0]), known, "a law")) for known in (0.019, 0.021)]
    assert [bool(why) for why in vague] == [False, True], "more than a percent of the state"


def test_error_back_in_time():
    def errors(p):
        run = ("pendulum", "rk4", "--steps", "100", "--quantity", "trajectory", "--p", p)
        return [integrate_json(*run, f"--t-end={t}")["quantity_error"]["error"] for t in (10, -10)]

    still, moving = errors("0"), errors("1")
    assert still[0] == pytest.approx(still[1], rel=1e-9), "at rest at the start, both ways are alike"
    assert moving[0] != pytest.approx(moving[1], rel=0.1), "control"


@pytest.mark.parametrize(
    ("span", "begin", "end"),
    [
        (("--h", "0.1", "--t-end", "-2"), 0.0, -2.0),
        (("--h", "0.1", "--t-end", "3", "--t0", "5"), 5.0, 3.0),
        (("--h", "-0.1", "--steps", "20"), 0.0, -2.0),
    ],
)
def test_span_may_start_anywhere_and_be_negative(span, begin, end):
    ahead = integrate_json("pendulum", "gauss-4", "--h", "0.1", "--t-end", "2")
    found = integrate_json("pendulum", "gauss-4", *span, "--error")
    assert found["t"] == pytest.approx(end)
    assert found["q"] == pytest.approx(ahead["q"], rel=1e-12)  # the pendulum starts at rest
    assert found["p"] == pytest.approx([np.sign(end - begin) * x for x in ahead["p"]], rel=1e-12)
    assert found["global_error"] < 1e-9


def test_energy_errors_are_absolute_and_relative():
    found = integrate_json("pendulum", "rk4", "--h", "0.1", "--t-end", "10")
    made = problem("pendulum")
    H0 = float(made.system.energies(np.array([made.q0]), np.array([made.p0]))[0])
    for key in ("max", "end"):
        assert found["relative_energy_error"][key] == pytest.approx(found["energy_error"][key] / abs(H0), rel=1e-14)
    nothing = integrate_json("rk4", "--hamiltonian", "p**2/2 + q**3/3", "--q", "0", *FORMULA[2:])
    assert nothing["relative_energy_error"] == {"max": None, "end": None}, "H0 = 0"


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rows.csv", "rows.npz"])
def test_trajectory_is_written(tmp_path, name):
    path = tmp_path / name
    s = integrate(problem(BOX), "rk4", h=0.1, t_end=10)
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
    assert all(np.array_equal(x, y[rows]) for x, y in ((t, s.t), (q, s.q), (p, s.p)))
    assert list(tmp_path.iterdir()) == [path]


def test_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "rows.csv"
    path.write_text("before")

    def full(*of):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    done = call("integrate", *RUN, "--output", path)
    assert (done.exit_code, "No space left" in done.stderr) == (2, True)
    assert (path.read_text(), [*tmp_path.iterdir()]) == ("before", [path])


def test_the_trajectory_is_kept_where_an_error_cannot_be_told(tmp_path):
    """A trajectory's error is told from 20 times: 21 steps are no multiple."""
    words = ["integrate", "pendulum", "pefrl", "--h", "0.1", "--steps", "21", "--quantity", "trajectory"]
    done = call(*words, "--output", tmp_path / "t.csv")
    assert done.exit_code == 2
    assert "must be a multiple" in " ".join(done.output.split())
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 23


# -- work and precision ------------------------------------------------------------------------------------------------


PENDULUM = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


@pytest.fixture(scope="module")
def result():
    return pb.workprecision(PENDULUM, ["pefrl", "heyoka", leapfrog], t_end=3.0, q0=[1.0], p0=[0.0])


def test_every_integrator_is_refined_to_round_off(result):
    frame = result.to_frame()
    assert list(dict.fromkeys(frame["method"])) == result.methods == ["pefrl", "heyoka", "leapfrog"]
    least = frame[frame["status"] == "ok"].groupby("method")["error"].min()
    assert least["pefrl"] < 1e-12
    assert least["heyoka"] < 1e-13
    assert 1e-12 < least["leapfrog"] < 1e-4, "it is called from Python"
    assert set(frame["kind"]) == {"phasebench", "heyoka", "own step"}


def test_accuracy_is_met_beyond_the_uncertainty_of_the_reference():
    """The faster run's error is below 1e-3 by less than the uncertainty; a failed run counts for nothing."""
    row = {"method": "a", "problem": "p", "t_end": 1.0, "quantity": "energy", "uncertainty": 2e-4}
    runs = [(9e-4, 1.0, "ok"), (7e-4, 2.0, "ok"), (1e-5, 0.5, "diverged")]
    rows = tuple(row | {"error": e, "seconds": s, "status": status} for e, s, status in runs)
    (line,) = WorkPrecision(rows).table()
    assert [line[x] for x in ("1e-01", "1e-03", "1e-05", "least error")] == ["1", "2", "-", "7.0e-04"]


def test_line_joins_falling_errors_only():
    errors = [3.0, 5.0, 1e-2, 1e-12, 3e-13, 9e-13, 2e-13, 4e-13]
    falling, rest = improving([{"error": e} for e in errors])
    assert [r["error"] for r in falling] == [3.0, 1e-2, 1e-12, 3e-13, 2e-13]
    assert [r["error"] for r in rest] == [5.0, 9e-13, 4e-13]


@pytest.mark.parametrize("suffix", [".svg", ".pdf", ".png"])
def test_figure_has_the_format_of_its_suffix(result, tmp_path, suffix):
    one, other = (result.plot(tmp_path / f"{k}{suffix}").read_bytes() for k in "ab")
    assert one.startswith({".svg": b"<?xml", ".pdf": b"%PDF", ".png": b"\x89PNG"}[suffix])
    assert one == other


def test_commands_measure_a_problem_of_ones_own_and_draw(tmp_path):
    mine, figure, path = (tmp_path / name for name in ("mine.py", "figure.svg", "rows.jsonl"))
    mine.write_text("""
from phasebench import Hamiltonian, Orbit, Problem

problem = Problem(
    id="quartic", name="quartic oscillator", source="mine",
    system=Hamiltonian(q="q", p="p", H="p**2/2 + q**4/4"), orbits=(Orbit("start", (1.0,), (0.0,)),),
)
""")
    methods = ("--method", "pefrl", "--method", "scipy-dop853")
    done = call("workprecision", mine, "--t-end", "2", *methods, "--json", "--output", figure)
    assert {r["method"] for r in json.loads(done.stdout)["rows"]} == {"pefrl", "scipy-dop853"}
    assert (done.exit_code, figure.exists()) == (0, True)
    assert call("run", mine, "--t-end", "5", "--method", "pefrl", "--output", path).exit_code == 0
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert ({r["method"] for r in rows}, len(rows) > 8) == ({"pefrl"}, True)


def test_a_span_to_which_no_reference_is_known_is_refused():
    with pytest.raises(pb.InvalidInput, match=r"the reference is known to \d.* alone"):
        pb.workprecision("henon-heiles:chaotic", ["rk4"], t_end=1000.0)
    assert pb.workprecision("double-pendulum:chaotic", ["rk4"], t_end=60.0, quantity="energy").methods == ["rk4"]
