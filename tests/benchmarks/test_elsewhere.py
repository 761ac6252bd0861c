"""Rows measured elsewhere: what a file must have, each refusal, the errors computed here, the example of SUNDIALS."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store import elsewhere
from phasebench.benchmarks.studies import elsewhere as study
from phasebench.integrators import InvalidInput
from phasebench.reference.solvers.taylor import reference
from support.commands import call

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SUNDIALS = study.FOLDER / "sundials-kepler.csv"
#: A file that is right: the pendulum to t = 2, its exact end state to a double, and one that is off by 1e-6.
MADE = problem("pendulum")


def exact() -> np.ndarray:
    """The state (q, p) of the pendulum at t = 2."""
    truth = reference(MADE, [2.0], certify=False)
    return np.array([truth.q[-1, 0], truth.p[-1, 0]])


@pytest.fixture(scope="module")
def good() -> str:
    """The text of a file that is right."""
    q, p = map(float, exact())
    energy = float(MADE.system.observe(MADE.system.H, np.array([MADE.q0]), np.array([MADE.p0]))[0])
    return f"""# phasebench-elsewhere: 1
# package: Somewhere.jl
# version: 1.2
# language: Julia 1.11
# machine: AMD Ryzen, Linux
# problem: pendulum
# q0: {MADE.q0[0]!r}
# p0: {MADE.p0[0]!r}
# energy: {energy!r}
# t_end: 2
method,h,steps,evaluations,q1,p1
Exact,0.1,20,60,{q!r},{p!r}
Off,0.1,20,60,{q + 1e-6!r},{p!r}
"""


@pytest.fixture
def read(tmp_path):
    """A function: text of a file -> its content."""

    def of(text: str):
        path = tmp_path / "rows.csv"
        path.write_text(text, encoding="utf-8")
        return elsewhere.read(path)

    return of


# -- reading ------------------------------------------------------------------------------------------------------


def test_errors_are_computed_against_the_reference(read, good):
    found = read(good)
    assert found.by == "Somewhere.jl 1.2, Julia 1.11"
    exactly, off = elsewhere.errors(found)
    assert exactly["error"] <= 2e-15
    assert off["error"] == pytest.approx(1e-6, rel=1e-6)
    assert 0 < off["uncertainty"] < 1e-13
    assert off["energy_error"] == pytest.approx(np.sin(exact()[0]) * 1e-6, rel=1e-4)
    assert (off["h"], off["tol"], off["steps"], off["evaluations"]) == (0.1, None, 20, 60)
    assert (off["package"], off["language"], off["made_on"]) == ("Somewhere.jl", "Julia 1.11", "AMD Ryzen, Linux")


Q0 = repr(MADE.q0[0])
#: (what is replaced, by what, words of the refusal).
REFUSED = {
    "another version": ("elsewhere: 1", "elsewhere: 2", "format '2'.*reads format 1"),
    "no version": ("# phasebench-elsewhere: 1\n", "", "does not begin with '# phasebench-elsewhere: 1'"),
    "unknown problem": ("problem: pendulum", "problem: pendlum", "did you mean.*pendulum"),
    "unknown parameter": ("# q0", "# set: e=0.6\n# q0", "problem 'pendulum' has no parameter 'e'"),
    "parameter without a value": ("# q0", "# set: e\n# q0", "must be like 'e=0.6"),
    "other initial data": (f"q0: {Q0}", "q0: 0.25", f"q0 is 0.25, and of pendulum.* it is {Q0}"),
    "another energy": ("energy: ", "energy: 7", "initial energy is .* there, and .* here"),
    "no machine": ("# machine: AMD Ryzen, Linux\n", "", "header lacks machine"),
    "unknown entry": ("# machine", "# machin", "machin.*did you mean.*machine"),
    "a line that is no entry": ("# machine: AMD Ryzen, Linux", "# AMD Ryzen", "not '# name: value'"),
    "a span that is none": ("t_end: 2", "t_end: -2", "t_end is -2; it must be positive"),
    "a time that is no number": ("t_end: 2", "t_end: two", "t_end is 'two'; it must be a finite number"),
    "no evaluations": (",evaluations,", ",", "lacks the column evaluations"),
    "half a state": (",q1,p1", ",q1", "lacks the column p1"),
    "no step": ("method,h,", "method,", "lacks the column h .or tol"),
    "times": (",steps,", ",seconds,", "times of another machine are not compared.*'seconds'"),
    "unknown column": (",steps,", ",stepz,", "stepz.*did you mean.*steps"),
    "a column twice": (",steps,", ",evaluations,", "'evaluations' twice"),
    "no rows": ("Exact,", "", "has no rows"),
    "a value too many": ("Exact,0.1", "Exact,0.1,0.1", "row 1 has 7 values for 6 columns"),
    "a step of 0": ("Exact,0.1", "Exact,0.0", "row 1: h is 0.0; it must be positive"),
    "neither step nor tolerance": ("Exact,0.1", "Exact,", "row 1: give h or tol"),
    "half an evaluation": ("20,60", "20,60.5", "evaluations is 60.5; it must be a whole number"),
    "evaluations that are not there": ("20,60", "20,", "row 1 has no number of evaluations"),
    "a state that is not finite": ("20,60,", "20,60,nan", "q1 is 'nan"),
    "no method": ("Exact,", ",", "row 1 names no method"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_file_that_cannot_be_compared_is_refused(read, good, why):
    old, new, words = REFUSED[why]
    text = good.replace(old, new, 1)
    if why == "no rows":
        text = good[: good.index("Exact,")]
    elif why in ("no evaluations", "half a state", "no step"):
        text = "\n".join(
            ",".join(line.split(",")[: text.splitlines()[10].count(",") + 1]) for line in text.splitlines()
        )
    assert text != good
    with pytest.raises(InvalidInput, match=f"(?s)rows.csv.*{words}"):
        read(text)


def test_digits_are_asked_for_and_a_stated_energy_error_is_checked(read, good):
    q, p = map(float, exact())
    head = good[: good.index("method,")]
    with pytest.raises(InvalidInput, match="has 5 digits; write all 17"):
        read(f"{head}method,h,evaluations,q1,p1\nA,0.1,20,{q:.4e},{p:.4e}\n")
    row = f"{head}method,tol,evaluations,energy_error,q1,p1\nA,1e-3,20,{{}},{q!r},{p!r}\n"
    assert read(row.format("1e-16")).rows[0]["energy_error"] == pytest.approx(0, abs=1e-14)
    with pytest.raises(InvalidInput, match="energy_error is 1e-09, and that of its state"):
        read(row.format("1e-9"))


# -- the stored answers of SUNDIALS -------------------------------------------------------------------------------


def test_methods_here_have_the_energy_errors_of_sundials(tmp_path):
    text = SUNDIALS.read_text().splitlines()
    rows = [line for line in text[13:] if ",0.1," in line or ",0.05," in line]
    path = tmp_path / "few.csv"
    path.write_text("\n".join(text[:13] + rows))
    theirs, ours = study.compare(elsewhere.read(path), ["pefrl", "gauss-4"])
    assert len(theirs) == 10
    assert max(abs(r["energy_error"] - r["twin_energy_error"]) for r in theirs) < study.SAME
    assert all(r["error"] is None and r["reason"] for r in theirs)
    budgets = sorted({r["evaluations"] for r in theirs})
    for name in ("pefrl", "gauss-4"):
        spent = [r["evaluations"] for r in ours if r["method"] == name]
        assert len(set(spent)) == len(spent) > 1
        assert all(any(study.USED * budget <= n <= budget for budget in budgets) for n in spent)
    assert all(r["error"] > 0 for r in ours if r["status"] == "ok")
    with pytest.raises(InvalidInput, match="'heyoka' cannot be compared: it takes no fixed step"):
        study.compare(elsewhere.read(path), ["heyoka"])


# -- the command --------------------------------------------------------------------------------------------------


def test_the_command_prints_errors_and_own_methods():
    told = call("elsewhere", EXAMPLES / "elsewhere.csv", "--method", "pefrl", "--json")
    assert told.exit_code == 0
    found = json.loads(told.stdout)
    assert found["phasebench-elsewhere"] == 1
    errors = [r["error"] for r in found["rows"]]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-9 < 1e-6 < errors[0]
    assert {r["method"] for r in found["own"]} == {"pefrl"}


def test_the_example_is_what_its_script_writes():
    """Versions and the last digits are those of the machine that ran it."""
    text = (EXAMPLES / "elsewhere.csv").read_text().splitlines()
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / "elsewhere_rows.py")], capture_output=True, text=True, check=True
    )
    here = done.stdout.splitlines()
    assert [line.partition(":")[0] for line in here[:11]] == [line.partition(":")[0] for line in text[:11]]
    for mine, kept in zip(here[11:], text[11:], strict=True):
        new, old = (np.array(line.split(",")[3:], dtype=float) for line in (mine, kept))
        assert new == pytest.approx(old, rel=1e-9, abs=1e-12)
