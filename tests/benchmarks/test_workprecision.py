"""`workprecision` on the user's system and step: rows, printed table, figure."""

from __future__ import annotations

import json

import pytest

import phasebench as pb
from phasebench.benchmarks.workprecision import WorkPrecision, improving
from support.commands import call
from support.steps import leapfrog

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


def test_command_measures_repeated_methods_and_draws(tmp_path):
    figure, methods = tmp_path / "a.svg", ("--method", "pefrl", "--method", "scipy-dop853")
    done = call("workprecision", "pendulum", "--t-end", "2", *methods, "--json", "--output", figure)
    assert {r["method"] for r in json.loads(done.stdout)["rows"]} == {"pefrl", "scipy-dop853"}
    assert (done.exit_code, figure.exists()) == (0, True)


def test_a_span_to_which_no_reference_is_known_is_refused():
    with pytest.raises(pb.InvalidInput, match=r"the reference is known to \d.* alone"):
        pb.workprecision("henon-heiles:chaotic", ["rk4"], t_end=1000.0)
    assert pb.workprecision("double-pendulum:chaotic", ["rk4"], t_end=60.0, quantity="energy").methods == ["rk4"]


def test_bad_input_gets_its_error(result, tmp_path):
    for t_end in (-1.0, float("nan"), True):
        with pytest.raises(pb.InvalidInput, match="t_end"):
            pb.workprecision("pendulum", t_end=t_end)
    with pytest.raises(pb.InvalidInput, match=r"\.pdf"):
        result.plot(tmp_path / "a.jpg")
