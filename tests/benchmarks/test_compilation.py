"""Methods that the compiler cannot make are named by `advise`, `workprecision` and `validate`, not left out."""

from __future__ import annotations

import itertools
import json

import numba
import numpy as np
import pytest
from typer.testing import CliRunner

import phasebench as pb
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.certificate import times
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.cli import app
from phasebench.benchmarks.experiments.trade import climb, front, sweep
from phasebench.benchmarks.experiments.trade.climb import Task
from phasebench.benchmarks.measure.compilation import (
    Failed,
    NotCompiled,
    compilation_error,
    failure_summary,
    naming,
)
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.quantities import Truth, quantity
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.benchmarks.problems.questions import Question, down_to
from phasebench.benchmarks.rows import workers
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.engine import kernel

WHY = "'_Linked' object has no attribute '_reload_init'"
#: Each problem has a constant of its own: what is compiled for one is not kept for another.
CONSTANTS = itertools.count(1)


def fresh() -> Problem:
    """A problem that nothing is compiled for."""
    system = Hamiltonian(q="q", p="p", H=f"p**2/2 + q**2/2 + {1 + next(CONSTANTS) / 1024!r}*q**4/4")
    return Problem("quartic", "a quartic oscillator", "", system, (Orbit("one", (1.0,), (0.0,)),))


def of(*ids):
    """A portfolio of a few."""
    return lambda asked, accuracy: ([(integrator(id), 1.0) for id in ids], [])


def answer(*ids):
    return advise(ask(fresh(), t_end=2.0, accuracy=1e-4), (), of(*ids))


@pytest.fixture
def break_compilation(monkeypatch):
    """A function that lets the compilation of some families fail; of all where none is named."""

    def break_(*families: str) -> None:
        compile_ = kernel._compiled

        def broken(prepared, d):
            family = prepared.run.__module__.rpartition(".")[2]
            if not families or family in families:
                raise AttributeError(f"{WHY}\nand a second line")
            return compile_(prepared, d)

        monkeypatch.setattr(kernel, "_compiled", broken)

    return break_


# -- which errors are of compilation ----------------------------------------------------------------------------------


def caught(work) -> Exception:
    with pytest.raises(Exception) as found:
        work()
    return found.value


def test_an_error_of_numba_is_one_of_compilation_and_has_one_line():
    error = caught(lambda: numba.njit(lambda x: x.nothing)(1))
    why = compilation_error(error)
    assert why.startswith("TypingError: ")
    assert "\n" not in why
    assert len(why) <= 200


@pytest.mark.parametrize("work", [lambda: 1 / 0, lambda: numba.njit(lambda x: 1 // x)(0)])
def test_control_an_error_of_a_run_is_none(work):
    assert compilation_error(caught(work)) is None


def test_an_error_of_compilation_carries_the_name():
    with pytest.raises(NotCompiled) as found, naming("rk4"):
        numba.njit(lambda x: x.nothing)(1)
    assert found.value.failed.integrator == "rk4"
    with pytest.raises(ZeroDivisionError), naming("rk4"):
        1 / 0  # noqa: B018


def test_the_summary_names_each_once_and_says_where_it_is_all():
    failed = [Failed("a", "why"), Failed("b", "other"), Failed("a", "why")]
    assert failure_summary([], all_own=True) == ""
    assert failure_summary(failed, all_own=False) == "a, b failed to compile: why"
    assert failure_summary(failed, all_own=True).startswith("None of this project's methods")


# -- advise -----------------------------------------------------------------------------------------------------------


def test_advice_says_which_methods_do_not_compile(break_compilation):
    break_compilation("runge_kutta")
    found = answer("heyoka", "stormer-verlet", "rk4")
    assert found["failed"] == [{"integrator": "rk4", "why": f"AttributeError: {WHY}"}]
    assert "rk4 failed to compile" in found["warning"]
    assert "rk4" not in {d["integrator"] for d in found["dropped"]}
    assert found["own"]["integrator"] == "stormer-verlet"


def test_advice_says_that_all_of_this_project_failed(break_compilation):
    break_compilation()
    found = answer("heyoka", "stormer-verlet", "rk4")
    assert [f["integrator"] for f in found["failed"]] == ["stormer-verlet", "rk4"]
    assert found["warning"].startswith("None of this project's methods")
    assert found["own"] is None
    assert found["choice"]["integrator"] == "heyoka"


def test_advice_without_a_choice_says_so_as_well(break_compilation):
    break_compilation()
    found = answer("stormer-verlet")
    assert found["choice"] is None
    assert [f["integrator"] for f in found["failed"]] == ["stormer-verlet"]
    assert "compiles" in found["why"]


def test_control_advice_where_everything_compiles():
    found = answer("heyoka", "stormer-verlet", "rk4")
    assert (found["failed"], found["warning"]) == ([], None)
    assert found["own"] is not None


def formula() -> list[str]:
    return ["--hamiltonian", f"p**2/2 + {1 + next(CONSTANTS) / 1024!r}*q**4/4", "--q", "1", "--p", "0"]


def test_the_command_begins_with_the_warning(break_compilation):
    break_compilation()
    line = ["advise", *formula(), "--t-end", "2", "--accuracy", "1e-4", "--limit", "3"]
    assert CliRunner().invoke(app, line).stdout.startswith("warning: None of this project's methods")
    told = json.loads(CliRunner().invoke(app, [*line, "--json"]).stdout)
    assert told["failed"]
    assert {f["why"] for f in told["failed"]} == {f"AttributeError: {WHY}"}
    assert not {f["integrator"] for f in told["failed"]} & {d["integrator"] for d in told["dropped"]}


def test_python_warns(break_compilation):
    break_compilation()
    with pytest.warns(UserWarning, match="None of this project's methods"):
        table = pb.advise(fresh(), t_end=2.0, accuracy=1e-4, limit=3.0)
    assert table.attrs["failed"]


# -- work and precision, the trade, the certificate --------------------------------------------------------------------


def test_work_and_precision_say_who_does_not_compile(break_compilation):
    line = ["workprecision", *formula(), "--t-end", "2", "--methods", "stormer-verlet,rk4,heyoka"]
    break_compilation("runge_kutta")
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0
    assert done.stdout.startswith("warning: rk4 failed to compile")
    told = json.loads(CliRunner().invoke(app, [*line, "--json"]).stdout)
    assert told["failed"] == [{"integrator": "rk4", "why": f"AttributeError: {WHY}"}]
    assert {r["method"] for r in told["rows"] if r["status"] == "ok"} == {"stormer-verlet", "heyoka"}


def test_control_work_and_precision_where_everything_compiles():
    line = ["workprecision", *formula(), "--t-end", "2", "--methods", "stormer-verlet,rk4", "--json"]
    told = json.loads(CliRunner().invoke(app, line).stdout)
    assert (told["failed"], told["warning"]) == ([], None)


def test_rows_of_the_trade_that_do_not_compile_fail_by_name(monkeypatch):
    monkeypatch.setattr(sweep, "integrate", lambda *a, **k: numba.njit(lambda x: x.nothing)(1))
    cells = [c for c in sweep.cells(quick=True) if c.key == {"scene": "kepler-t1", "method": "rk4"}]
    ((cell, rows, error, _),) = workers._here(cells, float("inf"))
    assert rows is None
    assert cell.key["method"] == "rk4"
    assert "TypingError" in error


def test_a_certificate_whose_comparison_does_not_compile_says_so(monkeypatch):
    def broken(problem, method):
        return numba.njit(lambda x: x.nothing)(1)

    chosen, row = subject(times.runge_kutta), {"on": "kepler-orbit", "curve": [(400, 1e-3)], "sizes": [100]}
    row["errors"] = [{"error": 1e-2, "evaluations": 400}]
    assert times.failures([times.timed_or_failed(chosen, row, lambda *a: None)]) == "", "the control"
    monkeypatch.setattr(times, "prepare", broken)
    found = times.timed_or_failed(chosen, row, lambda *a: None)
    assert [f["integrator"] for f in found["failed"]] == [times.REFERENCE]
    assert "TypingError" in times.failures([found])
    assert times.said([found]) == []


# -- the trade's climb ------------------------------------------------------------------------------------------------


@pytest.fixture
def climbing(monkeypatch):
    """The tables of a scene of two methods that stop at 1e-2."""
    made = problem("pendulum:swinging")
    asked = Question("s", "pendulum:swinging", 10.0, "end-state", down_to(2), "")
    end = integrate(made, "dop853", h=0.01, t_end=10.0)
    truth = Truth(np.concatenate([end.q[-1], end.p[-1]]), 1e-9, "")
    monkeypatch.setattr(front, "task_of", lambda scene: Task(asked, made, quantity(made, "end-state"), truth))
    entered = [integrator("stormer-verlet"), integrator("rk4")], {"nobody": "it cannot"}
    monkeypatch.setattr(front, "entered", lambda task: entered)
    return lambda: front.measured("s")


def dropped(tables) -> dict[str, str]:
    return {row["integrator"]: row["why"] for row in tables[front.DROPPED]}


@pytest.mark.parametrize("place", ["run", "clock"])
def test_who_does_not_compile_is_dropped_from_a_scene_by_name_and_no_rung_of_it_is_left(climbing, monkeypatch, place):
    owner, name = (Integrator, "run") if place == "run" else (Task, "bare")
    work = getattr(owner, name)

    def broken(*given, **more):
        one = given[0] if place == "run" else given[1]
        return numba.njit(lambda x: x.nothing)(1) if one.id == "rk4" else work(*given, **more)

    monkeypatch.setattr(owner, name, broken)
    tables = climbing()
    assert dropped(tables)["rk4"].startswith(f"{climb.UNCOMPILED}TypingError: ")
    assert dropped(tables)["nobody"] == "it cannot"
    assert {row["integrator"] for row in tables[front.RUNGS]} == {"stormer-verlet"}
    assert {row["ours integrator"] for row in tables[front.CHOICES]} == {"stormer-verlet"}


def test_control_a_scene_whose_methods_compile_drops_none_for_it(climbing):
    tables = climbing()
    assert "rk4" in {row["integrator"] for row in tables[front.RUNGS]}
    assert not any(why.startswith(climb.UNCOMPILED) for why in dropped(tables).values())


def test_control_another_error_of_a_climb_is_raised(climbing, monkeypatch):
    monkeypatch.setattr(Integrator, "run", lambda *given, **more: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        climbing()
