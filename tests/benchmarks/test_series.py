"""The drift of a stored series: a bounded oscillation, a true drift, uneven times, and files that cannot be used."""

from __future__ import annotations

import json

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.drift import POINTS
from phasebench.benchmarks.measure.drift import drift as estimated
from support.commands import call

T = np.linspace(0.0, 200.0, 3001)
#: Uneven times: drawn at random, and with steps that are wide and narrow in turns, as an adaptive integrator's.
GROWN = np.cumsum(1 + 0.6 * np.sin(0.05 * np.arange(3001)))
UNEVEN = {"random": np.sort(np.random.default_rng(2).uniform(0, 200, 3001)), "adaptive": 200 * GROWN / GROWN[-1]}


def swing(t):
    return -0.5 + 1e-3 * np.sin(t) + 3e-4 * np.cos(2.7 * t)


def test_bounded_oscillation_has_no_drift_and_its_size_is_told():
    found = pb.drift(T, swing(T))
    assert found.holds_zero
    assert found.interval[1] - found.interval[0] < 1e-9
    assert found.oscillation == pytest.approx(1.3e-3, rel=0.02)
    assert "uneven" not in found.method
    same = estimated(T, swing(T) - swing(T)[0])
    assert (found.slope, *found.interval) == (same.value, same.low, same.high), "it is the suite's estimator"


@pytest.mark.parametrize("sign", [1, -1])
def test_true_drift_is_found_where_a_line_is_led_astray(sign):
    found = pb.drift(T.tolist(), (swing(T) + sign * 1e-8 * T).tolist())
    assert not found.holds_zero
    assert found.slope == pytest.approx(sign * 1e-8, rel=1e-2)
    assert abs(metrics.slope(T, swing(T)).value) > 1e-8, "the control: the line through all points"


@pytest.mark.parametrize("kind", UNEVEN)
def test_uneven_times(kind):
    t = UNEVEN[kind]
    still, drifts = pb.drift(t, swing(t)), pb.drift(t, swing(t) + 1e-6 * t)
    assert still.holds_zero
    assert not drifts.holds_zero
    assert drifts.interval[0] <= 1e-6 <= drifts.interval[1]
    assert drifts.slope == pytest.approx(1e-6, rel=0.1)
    assert "uneven" in still.method
    index = pb.drift(T, swing(t) + 1e-6 * t)
    assert not abs(index.slope / drifts.slope - 1) < 1e-3, "the control: the number of a row is no time"


def test_interval_at_uneven_times_covers_the_true_drift():
    covered, widths = 0, []
    for seed in range(60):
        t = np.sort(np.random.default_rng(seed).uniform(0, 200, 1500))
        low, high = pb.drift(t, swing(t) + 1e-6 * t).interval
        covered += low <= 1e-6 <= high
        widths.append(high - low)
    assert np.median(widths) < 1e-6, "so wide an interval would cover anything"
    # At 95.75 % coverage, fewer than 50 of 60 draws are covered with probability 1e-4.
    assert covered >= 50


@pytest.mark.parametrize(
    ("t", "series", "said"),
    [(T[: POINTS - 1], T[: POINTS - 1], "too few"), (T, T[:-1], "one value for each time")]
    + [(T * 0, T, "rise or fall"), (T, np.where(T > 100, np.nan, T), "must be finite"), (T, ["x"], "list of numbers")]
    + [([T], [T], "its shape is")],
)
def test_unusable_series_are_refused(t, series, said):
    with pytest.raises(pb.InvalidInput, match=said):
        pb.drift(t, series)


def test_a_jump_is_no_steady_drift_but_seen():
    found = pb.drift(T, swing(T) + 0.02 * (T > 120))
    assert found.seen
    assert found.holds_zero
    assert found.oscillation == pytest.approx(1.3e-3, rel=0.1)
    assert [(c.kind, round(c.time), round(c.size, 3)) for c in found.changes] == [("jump", 120, 0.02)]
    assert max(map(len, repr(found).splitlines())) <= 100


# -- the command -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("slope", "code"), [(0.0, 0), (1e-6, 1)])
def test_exit_code_is_0_where_the_interval_holds_0(tmp_path, slope, code):
    path = tmp_path / "run.csv"
    lines = [f"{t!r},1.0,{e!r}" for t, e in zip(T.tolist(), (swing(T) + slope * T).tolist(), strict=True)]
    path.write_text("\n".join(["# a comment", "t,q,energy", *lines]))
    found = call("drift", path, "--json")
    assert found[0] == code
    assert list(json.loads(found[1]))[:4] == ["slope", "interval", "oscillation", "method"]
    assert json.loads(found[1])["slope"] == pytest.approx(slope, abs=1e-9)
    assert call("drift", path)[0] == code
    assert call("drift", path, "--time", "t", "--column", "q")[0] == 0


def test_exit_code_is_1_for_a_jump(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,energy\n" + "".join(f"{t},{e}\n" for t, e in zip(T, swing(T) + 0.02 * (T > 120), strict=True)))
    done = call("drift", path, "--json")
    assert done[0] == 1
    assert [c["kind"] for c in json.loads(done[1])["changes"]] == ["jump"]


#: The same rows, step, energy, kinetic energy, as programs write them, with the options that the file needs.
STEPS = np.arange(0, 400, 4)
ROWS = [(s, f"{-5 + 1e-3 * np.sin(0.3 * s) + 1e-4 * s:.9f}", f"{3 + 0.1 * np.sin(s):.5f}") for s in STEPS]
WRITTEN = {
    "openmm.csv": (
        '#"Step","Total Energy (kJ/mole)","Kinetic Energy (kJ/mole)"\n' + "\n".join(f"{a},{b},{c}" for a, b, c in ROWS),
        ("--time", "Step", "--column", "Total Energy (kJ/mole)", "--time-unit", "2 fs"),
    ),
    "log.lammps": (
        "LAMMPS (2 Aug 2026)\nunits real\nrun 400\n   Step  TotEng  KinEng\n"
        + "\n".join(" ".join(map(str, row)) for row in ROWS[:51])
        + "\nLoop time of 1.0 on 1 procs\nrun 200\nWARNING: slow\n  Step TotEng KinEng\n"
        + "\n".join(" ".join(map(str, row)) for row in ROWS[50:])
        + "\nLoop time of 1.0 on 1 procs",
        ("--time-unit", "2 fs", "--energy-unit", "kJ/mol"),
    ),
    "energy.xvg": (
        '# gmx energy\n@    title "Energies"\n@    xaxis  label "Time (ps)"\n@    yaxis  label "(kJ/mol)"\n'
        '@ s0 legend "Total Energy"\n@ s1 legend "Kinetic En."\n'
        + "\n".join(f"  {0.002 * a:.6f}  {b}  {c}" for a, b, c in ROWS),
        (),
    ),
    "ase.log": (
        "Time[ps]      Etot[eV]     Ekin[eV]\n"
        + "\n".join(
            f"{0.002 * a:.6f} {float(b) * 0.010364269656:.12f} {float(c) * 0.010364269656}" for a, b, c in ROWS
        ),
        (),
    ),
    "blanks.txt": (
        "# time energy ekin\n" + "\n".join(f"{0.002 * a:.6f}  {b}  {c}" for a, b, c in ROWS),
        ("--energy-unit", "kJ/mol", "--time-unit", "ps"),
    ),
    "nameless.txt": (
        "\n".join(f"{0.002 * a:.6f}  {b}" for a, b, _ in ROWS),
        ("--energy-unit", "kJ/mol", "--time-unit", "ps"),
    ),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_files_of_other_programs(tmp_path, name):
    path = tmp_path / name
    text, options = WRITTEN[name]
    path.write_text(text)
    code, said, *_ = call("drift", path, *options, "--atoms", "10", "--json")
    found = json.loads(said)
    assert code == 1
    # 1e-4 kJ/mol a step of 2 fs is 0.05 kJ/mol/ps; a tenth of it for an atom.
    assert found["per_atom"]["unit"] == "meV/atom/ps"
    assert found["per_atom"]["slope"] == pytest.approx(0.005 * 10.364269656, rel=0.02)
    if name != "nameless.txt":
        spread = np.std([float(c) for *_, c in ROWS])
        assert found["over_kinetic"] == pytest.approx(1e-4 * 396 / spread, rel=0.02)


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [("", (), "is empty"), ("a,energy\n1,2\n", (), "say --time"), ("t,q\n1,2\n", (), "no column 'energy'")]
    + [("t,energy\n1,x\n", (), "'x' in row 1"), ("t,energy\n1\n", (), "row 1 has 1 entries")]
    + [
        ("t,energy\n1,2\n", ("--time", "s"), "no column 's'"),
        ("t,energy\n1,2\n", (), "too few"),
        (None, (), "cannot be read"),
    ],
)
def test_unusable_files_are_refused(tmp_path, text, options, said):
    path = tmp_path / "run.csv"
    if text is not None:
        path.write_text(text)
    done = call("drift", path, *options, COLUMNS="100")
    assert done.exit_code == 2
    assert said in done.said
