"""The references: exact solutions, certified Taylor runs, stored tables."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mpmath
import numpy as np
import pandas as pd
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference import tables
from phasebench.reference.solvers import taylor, translate
from phasebench.reference.solvers.exact import exact
from phasebench.reference.solvers.taylor import ReferenceFailed, reference

TIMES = np.array([i * 0.5 for i in range(21)])


def distance(found, solution) -> np.ndarray:
    """The max norm over (q, p) of a reference's decimal strings minus an exact solution, row by row."""
    with mpmath.workdps(45):
        text = np.hstack([found.q_text, found.p_text])
        rows = zip(text, np.hstack(solution), strict=True)
        return np.array([float(max(abs(mpmath.mpf(a) - b) for a, b in zip(x, y, strict=True))) for x, y in rows])


def bare(system, q0, p0):
    return SimpleNamespace(system=system, q0=q0, p0=p0)


ROOMS = (
    "solvers.exact",
    "solvers.gauss",
    "solvers.taylor",
    "certificates.check",
    "certificates.stored",
    "peers",
    "tables",
)


def test_importing_the_references_loads_no_solver():
    imports = "\n".join(f"import phasebench.reference.{room}" for room in ROOMS)
    code = f"import sys\n{imports}\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "phasebench.reference.peers" in loaded
    assert not {"heyoka", "rebound", "scipy", "mpmath", "pandas", "sympy", "numba", "phasebench.benchmarks"} & set(
        loaded
    )


# -- exact solutions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("e", "t"), [(0.0, 3.0), (0.6, 7.0), (0.99, 1000.0)])
def test_kepler_conserves_its_invariants_to_all_digits(e, t):
    made = problem("kepler", e=e)
    q, p = exact(made, [0.0, t], 50)
    with mpmath.workdps(60):
        values = [
            [sp.lambdify((*made.system.q, *made.system.p), f, "mpmath")(*q[i], *p[i]) for i in (0, 1)]
            for f in (made.system.H, *made.invariants.values())
        ]
    assert max(abs(a - b) for a, b in values) < mpmath.mpf("1e-46")
    assert max(abs(q[1] - q[0])) > 0.01


def test_kepler_returns_after_a_period_and_not_after_another_time():
    made = problem("kepler", e=0.6)
    q, p = (np.array([mpmath.mpf(x) for x in v]) for v in (made.q0, made.p0))
    with mpmath.workdps(50):
        a = 1 / (2 / abs(q[0]) - p[1] ** 2)
        period = 2 * mpmath.pi * a ** mpmath.mpf("1.5")
    start, end = exact(made, [0.0, float(period)])[0]
    offset = float(period) - period
    assert abs(end[1] - start[1] - p[1] * offset) < 1e-30
    assert abs(a - 1) > 0  # the doubles' orbit is not the nominal one
    assert abs(a - 1) < 1e-15


def test_exact_solution_from_elsewhere_than_pericentre_meets_heyoka():
    made = problem("kepler")
    data = {"q0": (0.3, -1.1), "p0": (0.5, 0.4)}
    found = reference(made, TIMES, **data)
    assert (distance(found, exact(made, TIMES, **data)) <= 1.01 * found.uncertainty + 1e-23).all()


def test_no_exact_solution_where_there_is_none():
    assert exact(problem("henon-heiles"), [1.0]) is None
    assert exact(problem("kepler"), [1.0], p0=(0.0, 3.0)) is None


def test_a_quarter_of_the_oscillators_period_exchanges_position_and_momentum():
    made = problem("harmonic-oscillator", omega=1.3)
    q, p = exact(made, [np.pi / 2 / 1.3], q0=(0.5,), p0=(-0.7,))
    assert float(q[0, 0]) == pytest.approx(-0.7 / 1.3, abs=1e-15)
    assert float(p[0, 0]) == pytest.approx(-0.5 * 1.3, abs=1e-15)


def test_oscillator_refuses_a_frequency_that_is_not_the_systems():
    made = problem("harmonic-oscillator", omega=1.3)
    wrong = SimpleNamespace(id=made.id, system=made.system, q0=made.q0, p0=made.p0, parameters={"omega": 1.3 + 1e-12})
    with pytest.raises(ValueError, match="omega"):
        exact(wrong, [1.0])


# -- Taylor references ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "wrong"), [("harmonic-oscillator", {"omega": 1.3}), ("kepler", {"e": 0.6})])
def test_exact_solution_lies_within_the_stated_uncertainty(name, wrong):
    made = problem(name, **wrong)
    found = reference(made, TIMES)
    assert (found.uncertainty[1:] > 0).all()
    assert found.uncertainty.max() < 1e-16
    assert (distance(found, exact(made, TIMES)) <= 1.01 * found.uncertainty + 1e-23).all()
    (key, value), *_ = wrong.items()
    off = exact(problem(name, **{key: value * (1 + 1e-13)}), TIMES)
    assert (distance(found, off)[4:] > 10 * found.uncertainty[4:]).all()


def test_uncertainty_grows_with_time_on_a_chaotic_orbit_and_ends_the_horizon():
    found = reference(problem("henon-heiles:chaotic"), np.array([i * 10.0 for i in range(41)]))
    assert found.uncertainty[0] == 0
    assert found.uncertainty[1] < 1e-17
    assert found.uncertainty[-1] > 1e-9
    assert 50 < found.horizon() < 300
    assert 0 < found.horizon(1e-16) < found.horizon() < found.horizon(1e-8)
    assert found.horizon(0.0) == 0.0
    i = int(found.horizon() / 10)
    size = np.abs(np.hstack([found.q, found.p])).max(axis=1)
    assert found.uncertainty[i] <= 1e-13 * size[i]
    assert found.uncertainty[i + 1] > 1e-13 * size[i + 1]


def test_horizon_is_relative_to_the_state():
    t, uncertainty = np.array([1.0, 2.0]), np.array([5e-11, 5e-11])

    def horizon(size):
        q, p = np.full((2, 1), size), np.full((2, 1), -2 * size)
        return taylor.Reference(t, q, p, q.astype(str), p.astype(str), uncertainty, 0 * t).horizon(1e-13)

    assert horizon(1000.0) == 2.0
    assert horizon(0.1) == 0.0


def test_rows_are_the_long_double_run_and_rounding_is_told_apart():
    found = reference(problem("henon-heiles:box"), TIMES, certify=False)
    assert np.isnan(found.uncertainty).all()
    assert np.isnan(found.horizon())
    long = np.vectorize(np.longdouble, otypes=[np.longdouble])(np.hstack([found.q_text, found.p_text]))
    assert (long.astype(float) == np.hstack([found.q, found.p])).all()
    lost = np.abs(long - np.hstack([found.q, found.p])).max(axis=1)
    assert (lost.astype(float) == found.rounding).all()
    assert 0 < found.rounding.max() < 1e-16


def test_lotka_volterra_keeps_its_invariant_beyond_double():
    made = problem("lotka-volterra:4-8")
    found = reference(made, [0.0, 5.0], certify=False)
    with mpmath.workdps(40):
        invariant = sp.lambdify((*made.system.q, *made.system.p), made.system.H, "mpmath")
        values = [
            invariant(mpmath.mpf(u[0]), mpmath.mpf(v[0])) for u, v in zip(found.q_text, found.p_text, strict=True)
        ]
    assert abs(values[1] - values[0]) < 1e-17


def third() -> SimpleNamespace:
    """q'' = -q/3: a third is no double."""
    return bare(Hamiltonian(q="q", p="p", H="p**2/2 + q**2/6"), (1.0,), (0.0,))


def third_error() -> float:
    found = reference(third(), [10.0], certify=False)
    with mpmath.workdps(40):
        w = 1 / mpmath.sqrt(3)
        return float(distance(found, ([[mpmath.cos(10 * w)]], [[-w * mpmath.sin(10 * w)]]))[0])


def test_rationals_are_exact_in_extended_precision(monkeypatch):
    assert third_error() < 1e-18
    monkeypatch.setattr(translate, "number", lambda e, fp: fp(float(e)))
    assert third_error() > 1e-17


def test_numbers_keep_their_bits():
    import heyoka as hy

    quad = hy.real128
    assert translate.number(sp.Rational(1, 3), quad) == quad(1) / quad(3)
    assert translate.number(sp.Float(0.1), quad) == quad(0.1)
    assert translate.number(sp.Float(1e-30), np.longdouble) == np.longdouble(1e-30)
    assert translate.number(sp.Rational(2, 3), float) == 2 / 3
    assert abs(float(translate.number(sp.pi, quad) - quad("3.14159265358979323846264338327950288"))) < 1e-33


@pytest.mark.parametrize(
    "formula",
    [
        "q**5",
        "1/q**3",
        "(q**2 + p**2)**(-3/2)",
        "(q + p)**(5/2)",
        "sqrt(q)*p**7",
        "q**(1/3)",
        "sin(q)*cos(p) - exp(-q*p)/3 + log(q)",
        "tanh(q) + atan(p) + asin(q/2) + sinh(p)*cosh(q) + tan(q) + acos(q/3)",
        "0.1*q + pi",
        "2**q",
    ],
)
def test_translation_has_the_value_of_the_formula(formula):
    import heyoka as hy

    q, p = sp.symbols("q p", positive=True)
    e = sp.sympify(formula, locals={"q": q, "p": p})
    x, y = hy.make_vars("x", "y")
    f = hy.cfunc([translate.translate(e, {q: x, p: y}, float)], [x, y])
    assert f([0.7, 1.3])[0] == pytest.approx(float(e.subs({q: 0.7, p: 1.3})), rel=1e-14)


def test_high_powers_at_zero_are_no_nan():
    found = reference(bare(Hamiltonian(q="q", p="p", H="p**2/2 + q**6/6"), (0.0,), (1.0,)), [1.0], certify=False)
    assert 0.9 < found.q[0, 0] < 1


def test_what_has_no_translation_is_named():
    with pytest.raises(InvalidInput, match="sign"):
        reference(bare(Hamiltonian(q="q", p="p", H="p**2/2 + abs(q)"), (1.0,), (0.0,)), [1.0])


def test_a_failed_run_names_the_time():
    runaway = bare(Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4"), (1.0,), (1.0,))
    with pytest.raises(ReferenceFailed, match=r"t = 1\.31"):
        reference(runaway, [1.0, 5.0])


def test_too_many_steps_are_a_failure(monkeypatch):
    monkeypatch.setattr(taylor, "STEP_LIMIT", 3)
    with pytest.raises(ReferenceFailed, match="3 steps"):
        reference(third(), [1000.0])


@pytest.mark.parametrize("times", [[], [-1.0, 1.0], [1.0, 1.0], [2.0, 1.0], [np.nan]])
def test_times_must_increase(times):
    with pytest.raises(ValueError, match="times"):
        reference(third(), times)


def test_the_start_is_a_row():
    found = reference(third(), [0.0])
    assert found.t.tolist() == [0.0]
    assert found.q.tolist() == [[1.0]]


# -- tables -----------------------------------------------------------------------------------------------------------

KEYS, BANDS = ["method", "h"], {"error": (0.01, 1e-15)}


def frame() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "method": ["scheme-i(lam=1/3)", "avf", 'a "quoted", one'],
            "h": [0.1, 1 / 3, np.nan],
            "error": [1.23456789012345e-7, np.nan, np.inf],
            "steps": [3, 2**53 + 1, 5],
            "good": [True, False, True],
            "status": ["ok", "diverged", ""],
        }
    )


@pytest.fixture
def stored(tmp_path):
    return tables.write("t", frame(), {"made": "here", "n": 3}, tmp_path)


def test_table_round_trip(stored, tmp_path):
    back, origin = tables.read("t", tmp_path)
    pd.testing.assert_frame_equal(back, frame(), check_dtype=False, check_exact=True)
    assert origin == {"made": "here", "n": 3}
    assert [p.name for p in tmp_path.iterdir()] == ["t.csv"]
    assert tables.compare(frame(), back, KEYS, BANDS).empty
    with pytest.raises(FileNotFoundError):
        tables.read("other", tmp_path)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda s: s.replace("1.23456789012345e-07", "1.23456789012346e-07"), "checksum"),
        (lambda s: s.replace("1.23456789012345e-07", "lots"), r"column error: 'lots' is no float"),
        (lambda s: s.replace(",True,", ",yes,", 1), "is no bool"),
        (lambda s: s[: s.rindex("avf")], "checksum"),
        (lambda s: s[: s.rindex("avf") + 6], "cells"),
        (lambda s: s.replace("method,h,error", "method,h,err"), "lacks the columns error"),
        (lambda s: "".join(x for x in s.splitlines(True) if not x.startswith("#")), "lacks columns and sha256"),
        (lambda s: "".join(x for x in s.splitlines(True) if "sha256" not in x), "lacks sha256"),
        (lambda s: "".join(x for x in s.splitlines(True) if "made" not in x and "# n:" not in x), "no provenance"),
        (lambda s: s.replace('# made: "here"', "# made here"), "line 1 of its header"),
        (lambda s: s.replace('"float"', '"complex"'), "what the columns are"),
        (lambda s: "", "lacks columns and sha256"),
    ],
)
def test_corrupt_table_says_what_and_how_to_mend(stored, tmp_path, change, what):
    text = stored.read_text()
    assert change(text) != text
    stored.write_text(change(text))
    with pytest.raises(tables.CorruptTable, match=what) as error:
        tables.read("t", tmp_path)
    assert "t.csv" in str(error.value)
    assert "python -m pytest benchmarks --update-tables" in str(error.value)


def test_binary_rubbish_is_a_corrupt_table(stored, tmp_path):
    stored.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(tables.CorruptTable, match="no text"):
        tables.read("t", tmp_path)


def test_line_ends_of_another_system_do_no_harm(stored, tmp_path):
    stored.write_bytes(stored.read_bytes().replace(b"\n", b"\r\n"))
    pd.testing.assert_frame_equal(tables.read("t", tmp_path)[0], frame(), check_dtype=False)


@pytest.mark.parametrize(
    ("name", "origin"), [("../t", {"a": 1}), ("t", {}), ("t", {"sha256": 1}), ("t", {"a: b": 1}), ("t", {"a\n": 1})]
)
def test_unusable_names_and_provenance_are_refused(tmp_path, name, origin):
    with pytest.raises(ValueError):
        tables.write(name, frame(), origin, tmp_path)


@pytest.mark.parametrize("names", [["a", "#b"], ["a", 3], ["a", "a"]])
def test_columns_that_the_format_cannot_hold_are_refused(tmp_path, names):
    """One of them is enough."""
    with pytest.raises(ValueError, match="the columns' names must be unique text"):
        tables.write("t", pd.DataFrame([[1, 2]], columns=names), {"made": "here"}, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_text_that_is_missing_is_empty_and_one_that_begins_as_a_header_is_a_row(tmp_path):
    texts = pd.DataFrame({"name": ["# made: 3", "b", "#", "d"], "status": [None, np.nan, "", "ok"]}, dtype=object)
    tables.write("t", texts, {"made": "here"}, tmp_path / "new" / "folder")
    back, origin = tables.read("t", tmp_path / "new" / "folder")
    assert origin == {"made": "here"}
    assert back.to_numpy().tolist() == [["# made: 3", ""], ["b", ""], ["#", ""], ["d", "ok"]]


def test_a_header_without_a_blank_is_read_as_with_one(stored, tmp_path):
    stored.write_text(stored.read_text().replace("# made", "#made"))
    assert tables.read("t", tmp_path)[1] == {"made": "here", "n": 3}


@pytest.mark.parametrize(
    ("old", "new", "what"), [("1.23456789012345e-07", "lots", ", column error: 'lots'"), ("avf,", "", " has 5 cells")]
)
def test_a_corrupt_table_names_the_line_of_the_file(stored, tmp_path, old, new, what):
    text = stored.read_text()
    line = next(k for k, row in enumerate(text.splitlines(), 1) if old in row)
    stored.write_text(text.replace(old, new))
    with pytest.raises(tables.CorruptTable, match=f"line {line}{what}"):
        tables.read("t", tmp_path)


def test_a_failed_write_is_told_though_its_temporary_file_has_gone(stored, monkeypatch):
    def fails(temporary, path):
        Path(temporary).unlink()
        raise OSError("full")

    monkeypatch.setattr(tables.os, "replace", fails)
    with pytest.raises(OSError, match="full"):
        tables.write_file(stored, "new")


def test_a_failed_write_leaves_the_old_table(stored, tmp_path, monkeypatch):
    before = stored.read_bytes()
    monkeypatch.setattr(tables.os, "replace", lambda *a: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        tables.write("t", frame().head(1), {"made": "there"}, tmp_path)
    assert stored.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["t.csv"]


def changed(column, value, row=0):
    out = frame()
    out[column] = out[column].astype(object)
    out.loc[row, column] = value
    return out


@pytest.mark.parametrize(
    ("measured", "column"),
    [
        (changed("error", 1.26e-7), "error"),
        (changed("error", 0.0), "error"),
        (changed("error", np.nan), "error"),
        (changed("error", 1.0, row=1), "error"),
        (changed("error", 1.0, row=2), "error"),
        (changed("status", "diverged"), "status"),
        (changed("good", False), "good"),
        (frame().iloc[1:], "row"),
    ],
)
def test_compare_catches_a_change(measured, column):
    found = tables.compare(measured, frame(), KEYS, BANDS)
    assert found["column"].tolist() == [column]
    assert list(found.columns) == [*KEYS, "column", "measured", "stored", "allowed"]


def test_compare_allows_what_the_band_allows_and_tells_extra_rows():
    assert tables.compare(changed("error", 1.24e-7), frame(), KEYS, BANDS).empty
    assert tables.compare(changed("steps", 4), frame(), KEYS, BANDS).empty
    found = tables.compare(frame(), frame().iloc[:2], KEYS, BANDS)
    assert found[["measured", "stored"]].to_numpy().tolist() == [["present", "missing"]]


def test_compare_allows_a_difference_as_large_as_the_band_and_an_absolute_one_of_nothing():
    old = pd.DataFrame({"k": [1, 2, 3], "error": [1.0, 0.0, 1.0]})
    new = pd.DataFrame({"k": [1, 2, 3], "error": [1.75, 0.25, 1.76]})
    found = tables.compare(new, old, ["k"], {"error": (0.5, 0.25)})
    assert found.to_numpy().tolist() == [[3, "error", 1.76, 1.0, 0.75]]


def test_compare_goes_on_after_a_row_that_is_missing():
    found = tables.compare(changed("status", "slow", row=2).iloc[1:], frame(), KEYS, BANDS)
    assert found["column"].tolist() == ["row", "status"]


@pytest.mark.parametrize(("column", "value", "row"), [("status", "", 0), ("status", "ok", 2), ("steps", "three", 0)])
def test_compare_catches_what_is_given_in_one_table_only_or_is_a_number_there(column, value, row):
    new = changed(column, value, row)
    assert tables.compare(new, frame(), KEYS, BANDS)["column"].tolist() == [column]
    assert tables.compare(frame(), new, KEYS, BANDS)["column"].tolist() == [column]


def test_compare_passes_over_a_column_of_one_table():
    more = frame().assign(note="new")
    assert tables.compare(more, frame(), KEYS, BANDS).empty
    assert tables.compare(frame(), more, KEYS, BANDS).empty


def test_compare_refuses_tables_that_it_cannot_compare():
    with pytest.raises(ValueError, match="two rows"):
        tables.compare(pd.concat([frame(), frame()]), frame(), KEYS, BANDS)
    with pytest.raises(ValueError, match="measured table has no column 'error'"):
        tables.compare(frame().drop(columns="error"), frame(), KEYS, BANDS)
    with pytest.raises(ValueError, match="for its key"):
        tables.compare(frame().drop(columns="h"), frame(), KEYS, BANDS)


def test_difference_reads_as_lines():
    assert tables.difference(frame(), frame(), KEYS) == ""
    assert tables.difference(None, frame(), KEYS) == "new table of 3 rows"
    new = changed("error", 2.4691357802469e-7).iloc[:2].drop(columns="good")
    assert tables.difference(frame(), new, KEYS).splitlines() == [
        "- column good",
        "  method=scheme-i(lam=1/3), h=0.1: error 1.23456789012345e-07 -> 2.4691357802469e-07 (+100.00%)",
        '- row method=a "quoted", one, h=None',
    ]


@pytest.mark.parametrize(
    ("column", "old", "new", "line"),
    [
        ("status", "ok", "diverged", "status ok -> diverged"),
        ("error", 0.0, 1.0, "error 0.0 -> 1.0"),
        ("error", np.nan, 1.0, "error nan -> 1.0"),
        ("error", 1.0, np.nan, "error 1.0 -> nan"),
        ("error", -2.0, -1.0, "error -2.0 -> -1.0 (+50.00%)"),
    ],
)
def test_a_difference_is_relative_where_it_can_be(column, old, new, line):
    before, after = (changed(column, value).iloc[:1] for value in (old, new))
    assert tables.difference(before, after, KEYS) == f"  method=scheme-i(lam=1/3), h=0.1: {line}"


def test_provenance_follows_the_problem():
    made = problem("perturbed-kepler")
    origin = tables.provenance(made, scene="x")
    assert origin["scene"] == "x"
    assert origin["numpy"] == np.__version__
    assert origin == tables.provenance(problem("perturbed-kepler"), scene="x")
    stronger = tables.provenance(problem("perturbed-kepler", mu=0.0076))
    assert stronger["formulae"] != origin["formulae"]
    assert stronger["initial data"] == origin["initial data"]
    faster = tables.provenance(made_faster := replace(made, orbits=(replace(made.start, p=(0.0, 2.5)),)))
    assert made_faster.q0 == made.q0
    assert faster["initial data"] != origin["initial data"]
    rounder = tables.provenance(problem("perturbed-kepler", e=0.5))
    assert rounder["formulae"] == origin["formulae"]
    assert rounder["initial data"] != origin["initial data"]
