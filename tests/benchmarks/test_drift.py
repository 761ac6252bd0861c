"""The drift of an oscillating error: known slopes, coverage of its interval, controls."""

from __future__ import annotations

import json

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure import drift_coverage, metrics
from phasebench.benchmarks.measure.changes import changes
from phasebench.benchmarks.measure.drift import POINTS, drift
from support.commands import call

T = np.arange(4000) * 0.05


def swing(t, periods, phase=0.3):
    """An oscillation with a third harmonic, of amplitude 1e-3, over ``periods`` periods."""
    angle = 2 * np.pi * periods * t / t[-1] + phase
    return 1e-3 * (np.cos(angle) + 0.2 * np.cos(3 * angle))


@pytest.mark.parametrize(("t", "periods"), [(T, 2.3), (T, 66.6), (T[:300], 7.7)])
def test_drift_below_a_million_times_larger_oscillation(t, periods):
    slope = 1e-9 / t[-1]
    for sign in (-1, 0, 1):
        found = drift(t, swing(t, periods) + sign * slope * t)
        assert abs(found.value - sign * slope) < 1e-3 * slope
        assert found.low <= found.value <= found.high
        assert found.high - found.low < 0.01 * slope
        naive = metrics.slope(t, swing(t, periods) + sign * slope * t)
        assert abs(naive.value) > 10 * slope, "the control: a line through all points is led astray"


@pytest.mark.parametrize("kind", drift_coverage.KINDS)
def test_interval_covers_the_true_drift(kind):
    drawn = 8 if "peaked" in kind else 40  # a dear one
    found = [drift_coverage.coverage(kind, periods, 400, drawn=drawn) for periods in (3, 20)]
    # At 95.75 % coverage, fewer than 69 of 80 draws are covered with probability 1e-4, than 12 of 16 with 1e-3.
    assert sum(r["covered"] for r in found) * drawn >= (12 if drawn == 8 else 69)
    if drift_coverage.KINDS[kind].oscillation:
        assert found[0]["covered by the line"] < 0.6, "the control: the line through all points"


# -- jumps and onsets --------------------------------------------------------------------------------------------------


def wobble(seed: int, n: int = 200):
    """(generator, times, an oscillation with noise of a twentieth of its size)."""
    g = np.random.default_rng(seed)
    t = np.linspace(0, 300, n)
    angle = 2 * np.pi * g.uniform(4, 40) * t / t[-1] + g.uniform(0, 6)
    return g, t, np.cos(angle) + 0.3 * np.cos(2 * angle) + 0.05 * g.standard_normal(n)


def test_jumps_and_onsets_are_named_with_time_and_size():
    jumps = onsets = 0
    for seed in range(20):
        g, t, e = wobble(seed)
        at, size = g.uniform(45, 255), g.choice([-17, -3, 4, 17])
        found, slope = changes(t, e + size * (t >= at))
        near = [abs(c.time - at) < 4 and abs(c.size / size - 1) < 0.1 and c.kind == "jump" for c in found]
        jumps += near == [True] and slope.low <= 0 <= slope.high
        g, t, e = wobble(seed)
        at = g.uniform(100, 255)
        found, _ = changes(t, e + 0.5 * np.maximum(t - at, 0))
        onsets += [abs(c.time - at) < 12 and abs(c.size / 0.5 - 1) < 0.2 and c.kind == "onset" for c in found] == [True]
    assert (jumps >= 17, onsets >= 16) == (True, True)


@pytest.mark.parametrize("kind", ["with white noise", "peaked", "random walk alone", "white noise alone", "bursts"])
def test_noise_and_bursts_are_no_changes(kind):
    named = 0
    for seed in range(40):
        t, oscillation, noise = drift_coverage.series(kind, 12, 150, np.random.default_rng(seed))
        named += bool(changes(t, oscillation + noise)[0])
    # At 1 %, more than 3 of 40 are named with probability 1e-3.
    assert named <= 3


@pytest.mark.parametrize("rate", [3, 30, 300])
def test_decaying_error_has_no_drift_larger_than_itself(rate):
    for swinging in (0, 200):
        e = np.exp(-rate * T / T[-1]) * (1 + 0.3 * np.cos(swinging * T / T[-1]))
        found = drift(T, e)
        assert abs(found.value) * T[-1] < e.max()
        assert max(abs(found.low), abs(found.high)) * T[-1] < 3


def test_too_few_points_are_refused():
    with pytest.raises(ValueError, match="too few"):
        drift(np.arange(47.0), np.zeros(47))
    assert drift(np.arange(48.0), 2 * np.arange(48.0)).value == pytest.approx(2)
    alternating = drift(np.arange(400.0), np.where(np.arange(400) % 2, 1e-3, -1e-3))
    assert alternating.low <= 0 <= alternating.high


# -- the drift of a stored series --------------------------------------------------------------------------------------


TIMES = np.linspace(0.0, 200.0, 3001)
#: Uneven times: drawn at random, and with steps that are wide and narrow in turns, as an adaptive integrator's.
GROWN = np.cumsum(1 + 0.6 * np.sin(0.05 * np.arange(3001)))
UNEVEN = {"random": np.sort(np.random.default_rng(2).uniform(0, 200, 3001)), "adaptive": 200 * GROWN / GROWN[-1]}


def bounded(t):
    return -0.5 + 1e-3 * np.sin(t) + 3e-4 * np.cos(2.7 * t)


@pytest.mark.parametrize("kind", UNEVEN)
def test_uneven_times(kind):
    t = UNEVEN[kind]
    still, drifts = pb.drift(t, bounded(t)), pb.drift(t, bounded(t) + 1e-6 * t)
    assert still.holds_zero
    assert not drifts.holds_zero
    assert drifts.interval[0] <= 1e-6 <= drifts.interval[1]
    assert drifts.slope == pytest.approx(1e-6, rel=0.1)
    assert "uneven" in still.method
    index = pb.drift(TIMES, bounded(t) + 1e-6 * t)
    assert not abs(index.slope / drifts.slope - 1) < 1e-3, "the control: the number of a row is no time"


@pytest.mark.parametrize(
    ("t", "series", "said"),
    [(TIMES[: POINTS - 1], TIMES[: POINTS - 1], "too few"), (TIMES, TIMES[:-1], "one value for each time")]
    + [
        (TIMES * 0, TIMES, "rise or fall"),
        (TIMES, np.where(TIMES > 100, np.nan, TIMES), "must be finite"),
        (TIMES, ["x"], "list of numbers"),
    ]
    + [([TIMES], [TIMES], "its shape is")],
)
def test_unusable_series_are_refused(t, series, said):
    with pytest.raises(pb.InvalidInput, match=said):
        pb.drift(t, series)


# -- the command -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("slope", "jump", "code"), [(0.0, 0.0, 0), (1e-6, 0.0, 1), (0.0, 0.02, 1)])
def test_exit_code_is_0_where_the_interval_holds_0_and_nothing_jumps(tmp_path, slope, jump, code):
    path, series = tmp_path / "run.csv", bounded(TIMES) + slope * TIMES + jump * (TIMES > 120)
    lines = [f"{t!r},1.0,{e!r}" for t, e in zip(TIMES.tolist(), series.tolist(), strict=True)]
    path.write_text("\n".join(["# a comment", "t,q,energy", *lines]))
    done = call("drift", path, "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == call("drift", path)[0] == code
    assert list(found)[:4] == ["slope", "interval", "oscillation", "method"]
    assert found["interval"][0] < found["slope"] < found["interval"][1]
    assert found["slope"] == pytest.approx(slope, abs=1e-9 if not jump else 1e-6)
    assert found["oscillation"] == pytest.approx(1.3e-3, rel=0.1)
    assert "uneven" not in found["method"]
    named = [(c["kind"], round(c["time"]), round(c["size"], 3)) for c in found["changes"]]
    assert named == ([("jump", 120, jump)] if jump else [])
    assert call("drift", path, "--time", "t", "--column", "q")[0] == 0


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
