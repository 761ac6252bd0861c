"""`advise`, `workprecision` and `validate` name methods that fail to compile instead of omitting them."""

from __future__ import annotations

import itertools
import json

import numba
import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.certificate import costs, times
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.ladder import sweep
from phasebench.benchmarks.ladder.race import UNCOMPILED
from phasebench.benchmarks.ladder.rung import Task
from phasebench.benchmarks.measure.clock import Clocks
from phasebench.benchmarks.measure.compilation import (
    Failed,
    NotCompiled,
    compilation_error,
    failure_summary,
    naming,
)
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.benchmarks.problems.questions import down_to
from phasebench.benchmarks.store import workers
from phasebench.benchmarks.studies.trade import front
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.stepping import kernel
from support.commands import call
from support.portfolios import only

WHY = "'_Linked' object has no attribute '_reload_init'"
#: Each problem gets its own constant, so that no compiled function is reused.
CONSTANTS = itertools.count(1)


def fresh() -> Problem:
    """A problem for which nothing has been compiled."""
    system = Hamiltonian(q="q", p="p", H=f"p**2/2 + q**2/2 + {1 + next(CONSTANTS) / 1024!r}*q**4/4")
    return Problem("quartic", "a quartic oscillator", "", system, (Orbit("one", (1.0,), (0.0,)),))


def answer(*ids):
    """The advice on a problem for which nothing is compiled yet, from these integrators alone."""
    return advise(ask(fresh(), t_end=2.0, accuracy=1e-4), (), only(*ids))


@pytest.fixture
def break_compilation(monkeypatch):
    """A function that makes the compilation of the named families fail, or of all families without a name."""

    def break_(*families: str) -> None:
        compile_ = kernel._compile

        def broken(prepared, d):
            family = prepared.run.__module__.rpartition(".")[2]
            if not families or family in families:
                raise AttributeError(f"{WHY}\nand a second line")
            return compile_(prepared, d)

        monkeypatch.setattr(kernel, "_compile", broken)

    return break_


# -- compilation errors -----------------------------------------------------------------------------------------------


def caught(work) -> Exception:
    """The exception that a call raises."""
    with pytest.raises(Exception) as found:
        work()
    return found.value


def test_numba_error_is_a_one_line_compilation_error():
    error = caught(lambda: numba.njit(lambda x: x.nothing)(1))
    why = compilation_error(error)
    assert why.startswith("TypingError: ")
    assert "\n" not in why
    assert len(why) <= 200


@pytest.mark.parametrize("work", [lambda: 1 / 0, lambda: numba.njit(lambda x: 1 // x)(0)])
def test_control_run_time_error_is_no_compilation_error(work):
    assert compilation_error(caught(work)) is None


def test_compilation_error_carries_the_method():
    with pytest.raises(NotCompiled) as found, naming("rk4"):
        numba.njit(lambda x: x.nothing)(1)
    assert found.value.failed.integrator == "rk4"
    with pytest.raises(ZeroDivisionError), naming("rk4"):
        1 / 0  # noqa: B018


def test_summary_names_each_failed_method_once():
    failed = [Failed("a", "why"), Failed("b", "other"), Failed("a", "why")]
    assert failure_summary([], all_own=True) == ""
    assert failure_summary(failed, all_own=False) == "a, b failed to compile: why"
    assert failure_summary(failed, all_own=True).startswith("None of this project's methods")


# -- advise -----------------------------------------------------------------------------------------------------------


def test_advice_names_methods_that_fail_to_compile(break_compilation):
    break_compilation("runge_kutta")
    found = answer("heyoka", "stormer-verlet", "rk4")
    assert found["failed"] == [{"integrator": "rk4", "why": f"AttributeError: {WHY}"}]
    assert "rk4 failed to compile" in found["warning"]
    assert "rk4" not in {d["integrator"] for d in found["dropped"]}
    assert found["own"]["integrator"] == "stormer-verlet"


def test_advice_where_all_own_methods_fail_to_compile(break_compilation):
    break_compilation()
    found = answer("heyoka", "stormer-verlet", "rk4")
    assert [f["integrator"] for f in found["failed"]] == ["stormer-verlet", "rk4"]
    assert found["warning"].startswith("None of this project's methods")
    assert found["own"] is None
    assert found["choice"]["integrator"] == "heyoka"


def test_advice_without_a_choice_names_failed_methods(break_compilation):
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


@pytest.fixture
def few(monkeypatch):
    """`advise` of the command and of the Python interface tries these integrators alone."""
    monkeypatch.setattr(advise, "__defaults__", ((), only("heyoka", "stormer-verlet", "rk4")))


@pytest.mark.usefixtures("few")
def test_command_begins_with_the_warning(break_compilation):
    break_compilation()
    line = ["advise", *formula(), "--t-end", "2", "--accuracy", "1e-4", "--time-limit", "3"]
    assert call(*line).stdout.startswith("warning: None of this project's methods")
    told = json.loads(call(*line, "--json").stdout)
    assert told["failed"]
    assert {f["why"] for f in told["failed"]} == {f"AttributeError: {WHY}"}
    assert not {f["integrator"] for f in told["failed"]} & {d["integrator"] for d in told["dropped"]}


@pytest.mark.usefixtures("few")
def test_python_interface_warns(break_compilation):
    break_compilation()
    with pytest.warns(UserWarning, match="None of this project's methods"):
        table = pb.advise(fresh(), t_end=2.0, accuracy=1e-4, time_limit=3.0)
    assert table.to_frame().attrs["failed"]


# -- work-precision, trade-off front, certificate ----------------------------------------------------------------------


def test_workprecision_names_failed_methods(break_compilation):
    methods = ("--method", "stormer-verlet", "--method", "rk4", "--method", "heyoka")
    line = ["workprecision", *formula(), "--t-end", "2", *methods]
    break_compilation("runge_kutta")
    done = call(*line)
    assert done.exit_code == 0
    assert done.stdout.startswith("warning: rk4 failed to compile")
    told = json.loads(call(*line, "--json").stdout)
    assert told["failed"] == [{"integrator": "rk4", "why": f"AttributeError: {WHY}"}]
    assert {r["method"] for r in told["rows"] if r["status"] == "ok"} == {"stormer-verlet", "heyoka"}


def test_control_workprecision_where_everything_compiles():
    line = ["workprecision", *formula(), "--t-end", "2", "--method", "stormer-verlet", "--method", "rk4", "--json"]
    told = json.loads(call(*line).stdout)
    assert (told["failed"], told["warning"]) == ([], None)


def test_sweep_cell_that_fails_to_compile_has_the_error(monkeypatch):
    monkeypatch.setattr(sweep, "integrate", lambda *a, **k: numba.njit(lambda x: x.nothing)(1))
    cells = [c for c in sweep.cells(quick=True) if c.key == {"scene": "kepler-t1", "method": "rk4"}]
    ((_, answer),) = workers.measure(cells, workers.POOL, float("inf"))
    assert answer.value is None
    assert "TypingError" in answer.error


def test_certificate_whose_timing_reference_fails(monkeypatch):
    def broken(problem, method):
        return numba.njit(lambda x: x.nothing)(1)

    chosen, row = subject(times.runge_kutta), {"on": "kepler-orbit", "curve": [(400, 1e-3)], "sizes": [100]}
    row["errors"] = [{"error": 1e-2, "evaluations": 400}]
    assert times.failures([times.timed_or_failed(chosen, row, lambda *a: None)]) == "", "the control"
    monkeypatch.setattr(times, "prepare", broken)
    found = times.timed_or_failed(chosen, row, lambda *a: None)
    assert [f["integrator"] for f in found["failed"]] == [times.REFERENCE]
    assert "TypingError" in times.failures([found])
    place = [{"on": row["on"], "errors": [{"error": 1e-2, "factor": 2.0}]}]
    _, _, *lines = costs.format_costs(Tables({"place": place}), [found])
    assert lines == ["  kepler-orbit  1e-02  2 times"], "no time"


# -- the trade-off front ----------------------------------------------------------------------------------------------


@pytest.fixture
def climbing(monkeypatch):
    """A function that measures a trade-off scene with two methods only, at ever finer steps until the error is 1e-2."""
    made = problem("pendulum:swinging")
    end = integrate(made, "dop853", h=0.01, t_end=10.0)
    truth = Truth(np.concatenate([end.q[-1], end.p[-1]]), 1e-9, "")
    monkeypatch.setattr(
        front, "task_of", lambda scene: Task(made, 10.0, quantity(made, "end-state"), truth, down_to(2))
    )
    entered = [integrator("stormer-verlet"), integrator("rk4")], {"nobody": "it cannot"}
    monkeypatch.setattr(front, "entrants", lambda task: entered)
    return lambda: front.measure("s")


def dropped_reasons(tables) -> dict[str, str]:
    return {row["integrator"]: row["why"] for row in tables[front.DROPPED]}


@pytest.mark.parametrize("place", ["run", "clock"])
def test_uncompiled_method_is_dropped_from_a_scene(climbing, monkeypatch, place):
    owner, name = (Integrator, "run") if place == "run" else (Clocks, "of")
    work = getattr(owner, name)

    def broken(*given, **more):
        one = given[0] if place == "run" else given[1]
        return numba.njit(lambda x: x.nothing)(1) if one.id == "rk4" else work(*given, **more)

    monkeypatch.setattr(owner, name, broken)
    tables = climbing()
    assert dropped_reasons(tables)["rk4"].startswith(f"{UNCOMPILED}TypingError: ")
    assert dropped_reasons(tables)["nobody"] == "it cannot"
    assert {row["integrator"] for row in tables[front.RUNGS]} == {"stormer-verlet"}
    assert {row["ours integrator"] for row in tables[front.CHOICES]} == {"stormer-verlet"}


def test_control_scene_whose_methods_compile(climbing):
    tables = climbing()
    assert "rk4" in {row["integrator"] for row in tables[front.RUNGS]}
    assert not any(why.startswith(UNCOMPILED) for why in dropped_reasons(tables).values())


def test_control_other_errors_are_raised(climbing, monkeypatch):
    monkeypatch.setattr(Integrator, "run", lambda *given, **more: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        climbing()
