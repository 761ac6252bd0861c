"""Work-precision of one's own: rows, a table, and a figure that says what it shows."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

import phasebench as pb
from phasebench.benchmarks.cli import app
from phasebench.benchmarks.page import style
from phasebench.benchmarks.workprecision import CURVES, improving

PENDULUM = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


def leapfrog(system, q, p, h):
    """Kick, drift, kick."""
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)


@pytest.fixture(scope="module")
def found():
    return pb.workprecision(PENDULUM, ["pefrl", "heyoka", leapfrog], t_end=3.0, q0=[1.0], p0=[0.0])


def test_every_integrator_goes_from_where_it_breaks_to_round_off(found):
    frame = found.to_frame()
    assert list(dict.fromkeys(frame["method"])) == found.methods == ["pefrl", "heyoka", "leapfrog"]
    least = frame[frame["status"] == "ok"].groupby("method")["error"].min()
    assert least["pefrl"] < 1e-12
    assert least["heyoka"] < 1e-13
    assert 1e-12 < least["leapfrog"] < 1e-4, "it is called from Python"
    assert set(frame["kind"]) == {"phasebench", "heyoka", "own step"}


def test_it_prints_as_a_table(found):
    lines = repr(found).splitlines()
    assert len(lines) == 2 + len(found.methods)
    assert "t = 0 to 3" in lines[0]
    assert "array" not in repr(found)


def test_a_line_joins_what_improves():
    errors = [3.0, 5.0, 1e-2, 1e-12, 3e-13, 9e-13, 2e-13, 4e-13]
    falling, rest = improving([{"error": e} for e in errors])
    assert [r["error"] for r in falling] == [3.0, 1e-2, 1e-12, 3e-13, 2e-13]
    assert [r["error"] for r in rest] == [5.0, 9e-13, 4e-13]


@pytest.mark.parametrize("suffix", [".svg", ".pdf", ".png"])
def test_a_figure_is_what_its_ending_says(found, tmp_path, suffix):
    one, other = (found.plot(tmp_path / f"{k}{suffix}").read_bytes() for k in "ab")
    assert one.startswith({".svg": b"<?xml", ".pdf": b"%PDF", ".png": b"\x89PNG"}[suffix])
    assert one == other


def test_a_figure_says_what_it_shows(found, tmp_path):
    text = found.plot(tmp_path / "a.svg").read_text()
    for words in ("pefrl", "heyoka (peer)", "leapfrog (own step)", "t = 0 to 3", "end-state", "seconds"):
        assert words in text
    with pytest.raises(pb.InvalidInput, match=r"\.pdf"):
        found.plot(tmp_path / "a.jpg")
    with pytest.raises(pb.InvalidInput, match="cannot be written"):
        found.plot(tmp_path / "none" / "a.svg")


def test_curves_differ_in_colour_and_in_marker():
    looks = style.looks()
    assert len(looks) == CURVES
    for name in ("color", "marker"):
        assert len({str(look[name]) for look in looks}) == CURVES


def test_methods_are_repeated_or_given_the_old_way(tmp_path):
    figure = tmp_path / "a.svg"
    new = ["workprecision", "pendulum", "--t-end", "2", "--method", "pefrl", "--method", "scipy-dop853", "--json"]
    old = ["workprecision", "pendulum", "--t-end", "2", "--methods", "pefrl,scipy-dop853", "--json"]
    done = [CliRunner().invoke(app, line) for line in ([*new, "--output", str(figure)], old)]
    assert [d.exit_code for d in done] == [0, 0]
    names = [{r["method"] for r in json.loads(d.stdout)["rows"]} for d in done]
    assert names == [{"pefrl", "scipy-dop853"}] * 2
    assert "--method" in done[1].stderr
    assert "--method" not in done[0].stderr
    assert figure.exists()


@pytest.mark.parametrize("t_end", [0, -1.0, float("nan"), True, "10"])
def test_a_span_is_a_positive_number(t_end):
    with pytest.raises(pb.InvalidInput, match="t_end"):
        pb.workprecision("pendulum", t_end=t_end)
