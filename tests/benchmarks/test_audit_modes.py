"""The audit's floating-point modes: who changes the mode is found, a process that was spoilt judges nobody."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.audit import bench_audit, modes, page
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.reference.peers import BY_ID, Run, floating
from support.flushing import flush, only_there
from support.planted import control


def peer(run=None, **more) -> Integrator:
    """A peer that stands still, unless told otherwise."""
    still = run or (lambda task: Run.stuck(task, 0, 0, 0.0))
    return Integrator(replace(control("stormer-verlet"), run=still, lacks=lambda problem, system: None, **more))


def raising(error, after=lambda: None):
    def run(*_):
        after()
        raise error

    return run


def flushing(task):
    flush()
    return Run.stuck(task, 0, 0, 0.0)


@only_there
@pytest.mark.parametrize(
    ("chosen", "mode", "status"),
    [
        (peer(), modes.KEPT, "ok"),
        (peer(flushing), modes.BY_RUN, "ok"),
        (peer(raising(ValueError("broken"), flush)), modes.BY_RUN, "ok"),
        (peer(raising(ValueError("broken"))), None, "invalid"),
        (peer(load=lambda name: flush()), modes.BY_LOADING, "ok"),
        (peer(load=raising(ImportError("gone"))), None, "skipped"),
    ],
    ids=["kept", "run", "raises-later", "raises", "loading", "gone"],
)
def test_what_a_run_leaves_is_seen(chosen, mode, status):
    try:
        found = modes.row(chosen)
    finally:
        flush(False)
    assert (found["mode"], found["status"]) == (mode, status)
    assert found["problem"] == "kepler"


@only_there
def test_a_process_that_was_spoilt_judges_nobody():
    flush()
    try:
        found = modes.row(peer())
    finally:
        flush(False)
    assert (found["mode"], found["status"]) == (None, "invalid")
    assert modes.row(peer())["mode"] == modes.KEPT


def test_one_that_can_do_nothing_is_not_judged():
    nothing = Integrator(replace(control("rk4"), lacks=lambda problem, system: "it cannot"))
    assert modes.row(nothing)["status"] == "skipped"


def test_after_one_that_changes_the_mode_comes_a_new_process(monkeypatch):
    monkeypatch.setattr(
        modes, "CODE", "import json, os, sys; print(json.dumps({'peer': sys.argv[1], 'in': os.getpid()}))"
    )
    rows = modes.measured(("rk4", "gauss-2", "rebound-leapfrog"))[modes.TABLE]
    assert [r["peer"] for r in rows] == ["rk4", "gauss-2", "rebound-leapfrog"]
    assert len({r["in"] for r in rows}) == 3


def test_a_process_that_dies_is_a_row_and_the_next_goes_on(monkeypatch):
    code = (
        "import json, sys\nif sys.argv[1] == 'rk4': sys.exit(3)\nfor x in sys.argv[1:]: print(json.dumps({'peer': x}))"
    )
    monkeypatch.setattr(modes, "CODE", code)
    died, *others = modes.measured(("rk4", "gauss-2", "rebound-leapfrog"))[modes.TABLE]
    assert (died["peer"], died["status"], died["mode"]) == ("rk4", "invalid", None)
    assert "code 3" in died["reason"]
    assert [r["peer"] for r in others] == ["gauss-2", "rebound-leapfrog"]


def test_a_process_that_does_not_return_is_a_row(monkeypatch):
    code = "import json, sys, time\nprint(json.dumps({'peer': sys.argv[1]}), flush=True)\ntime.sleep(60)"
    monkeypatch.setattr(modes, "CODE", code)
    monkeypatch.setattr(modes, "LOADING", 0.5)
    monkeypatch.setattr(modes, "EACH", 0.0)
    assert [r["peer"] for r in modes.measured(("rk4", "gauss-2"))[modes.TABLE]] == ["rk4", "gauss-2"]
    monkeypatch.setattr(modes, "CODE", "import time; time.sleep(60)")
    (row,) = modes.measured(("rk4",))[modes.TABLE]
    assert row["reason"] == "it did not return within 0.5 s"


def test_whfast512_is_found_out_in_a_fresh_process():
    whfast = BY_ID["rebound-whfast512"]
    if whfast.lacks(None, modes.cases.problem(modes.cases.BY_NAME["kepler"]).system):
        pytest.skip("no AVX512")
    found = {r["peer"]: r for r in modes.measured((whfast.id, "rebound-whfast-plain"))[modes.TABLE]}
    assert {r["status"] for r in found.values()} == {"ok"}
    assert found["rebound-whfast-plain"]["mode"] == modes.KEPT
    if found[whfast.id]["version"] == "5.2.2":
        assert found[whfast.id]["mode"] == modes.BY_RUN
    assert floating.gradual()


# -- what the page says of it ------------------------------------------------------------------------------------------


def left(*of: tuple[str, str | None, str]) -> pd.DataFrame:
    """(peer, mode, status) each."""
    rows = [{"peer": p, "mode": m, "status": s, "package": p.partition("-")[0]} for p, m, s in of]
    return pd.DataFrame(rows).assign(version="1.2", reason="")


GOOD = left(("p-1", modes.KEPT, "ok"), ("p-2", modes.KEPT, "ok"), ("p-3", None, "skipped"))
BAD = left(("p-1", modes.KEPT, "ok"), ("p-2", modes.BY_RUN, "ok"), ("q-1", modes.BY_LOADING, "ok"))
OURS = left(("phasebench-x", modes.BY_RUN, "ok"))


def test_the_sentence_names_who_changes_the_mode():
    good, bad = page.left_as_found({modes.TABLE: GOOD}.get), page.left_as_found({modes.TABLE: BAD}.get)
    assert good.holds
    assert good.text == "2 of 2 integrators leave the process's floating-point mode as they found it."
    assert not bad.holds
    assert bad.text.startswith(
        "1 of 3 integrators leave the process's floating-point mode as they found it; after p-2 and q-1"
    )
    assert bad.short == "2 of 3 integrators change the process's floating-point mode."
    assert page.left_as_found({modes.TABLE: GOOD.tail(1)}.get) is None
    assert page.left_as_found({}.get) is None
    assert page.left_as_found({modes.TABLE: OURS}.get) is None, "a control is no peer"


def test_each_change_is_a_line_of_the_table():
    shown = page.table({modes.TABLE: BAD}.get).frame
    assert shown[["package", "said", "verdict"]].to_numpy().tolist() == [
        ["p 1.2", "(nothing) p-2", "floating-point mode changed by a run"],
        ["q 1.2", "(nothing) q-1", "floating-point mode changed as the package is loaded"],
    ]
    assert page.table({modes.TABLE: GOOD}.get) is None


def test_a_control_that_changes_the_mode_fails_the_run():
    bench_audit.bench_audit_modes({modes.TABLE: [*GOOD.to_dict("records"), *BAD.to_dict("records")]}.get)
    with pytest.raises(AssertionError, match="phasebench-x"):
        bench_audit.bench_audit_modes({modes.TABLE: OURS.to_dict("records")}.get)


def stated(verdict: str) -> pd.DataFrame:
    return pd.DataFrame([{"package": "p", "verdict": verdict, "severity": "wrong label", "script": "of_p"}])


def test_a_finding_of_either_is_one_of_both():
    def said(verdict, found):
        return page.beside_claims({"audit_statements": stated(verdict), modes.TABLE: found}.get)

    assert said("holds", GOOD).holds
    assert not said("contradicted", GOOD).holds
    assert "documentation" in said("contradicted", GOOD).short
    assert not said("holds", BAD).holds
    assert "floating-point mode" in said("holds", BAD).short
    for part in ("statements of documentation", "floating-point mode"):
        assert part in said("holds", GOOD).text
    assert page.beside_claims({modes.TABLE: BAD}.get).text == page.left_as_found({modes.TABLE: BAD}.get).text
    assert page.beside_claims({}.get) is None
