"""`advise`, `workprecision` and `validate` name methods that fail to compile instead of omitting them."""

from __future__ import annotations

import itertools
import json

import numba
import pytest

from phasebench.benchmarks.advice.advise import advise
from phasebench.benchmarks.certificate import times
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.measure.compilation import NotCompiled, compilation_error, naming
from phasebench.integrators.stepping import kernel
from support.commands import call
from support.portfolios import only

#: Each formula gets its own constant, so that no compiled function is reused.
CONSTANTS = itertools.count(1)
FAILED = "AttributeError: '_Linked' object has no attribute '_reload_init'"


def broken(*_):
    """Fail to compile."""
    return numba.njit(lambda x: x.nothing)(1)


@pytest.fixture
def run(monkeypatch):
    """A function (command, broken families, "all" or none) -> its answers: JSON and the first line of its text."""
    monkeypatch.setattr(advise, "__defaults__", ((), only("heyoka", "stormer-verlet", "rk4")))
    compile_ = kernel._compile

    def of(*words: str, families: tuple[str, ...] = ()):
        def compiling(prepared, d):
            family = prepared.run.__module__.rpartition(".")[2]
            if family in families or "all" in families:
                raise AttributeError(f"{FAILED.partition(': ')[2]}\nand a second line")
            return compile_(prepared, d)

        monkeypatch.setattr(kernel, "_compile", compiling)
        H = f"p**2/2 + {1 + next(CONSTANTS) / 1024!r}*q**4/4"
        line = (words[0], "--hamiltonian", H, "--q", "1", "--p", "0", "--t-end", "2", *words[1:])
        return json.loads(call(*line, "--json").stdout), call(*line).stdout.splitlines()[0]

    return of


def test_compilation_error_is_one_line_and_carries_the_method():
    with pytest.raises(NotCompiled) as found, naming("rk4"):
        broken()
    assert found.value.failed.integrator == "rk4"
    for work, prefix in (
        (broken, "TypingError: "),
        (lambda: 1 / 0, None),
        (lambda: numba.njit(lambda x: 1 // x)(0), None),
    ):
        with pytest.raises(Exception) as caught:
            work()
        why = compilation_error(caught.value)
        assert why is None if prefix is None else why.startswith(prefix) and "\n" not in why and len(why) <= 200
    with pytest.raises(ZeroDivisionError), naming("rk4"):
        1 / 0  # noqa: B018


@pytest.mark.parametrize(
    ("families", "failed", "own"),
    [((), [], True), (("runge_kutta",), ["rk4"], True), (("all",), ["stormer-verlet", "rk4"], False)],
)
def test_advice_names_methods_that_fail_to_compile(run, families, failed, own):
    found, first = run("advise", "--accuracy", "1e-4", "--time-limit", "60", families=families)
    assert found["failed"] == [{"integrator": id, "why": FAILED} for id in failed]
    assert not {*failed} & {d["integrator"] for d in found["dropped"]}
    assert (found["own"] is not None) is own
    assert found["choice"] is not None
    assert first.startswith("warning: ") is bool(failed)
    assert (found["warning"] or "").startswith("None of this project's methods") is not own


def test_certificate_whose_timing_reference_fails(monkeypatch):
    chosen, row = subject(times.runge_kutta), {"on": "kepler-orbit", "curve": [(400, 1e-3)], "sizes": [100]}
    row["errors"] = [{"error": 1e-2, "evaluations": 400}]
    assert times.failures([times.timed_or_failed(chosen, row, lambda *a: None)]) == "", "the control"
    monkeypatch.setattr(times, "prepare", broken)
    found = times.timed_or_failed(chosen, row, lambda *a: None)
    assert [f["integrator"] for f in found["failed"]] == [times.REFERENCE]
    assert "TypingError" in times.failures([found])
    place = [{"on": row["on"], "errors": [{"error": 1e-2, "factor": 2.0}]}]
    _, _, *lines = times.format_costs(Tables({"place": place}), [found])
    assert lines == ["  kepler-orbit  1e-02  2 times"], "no time"
