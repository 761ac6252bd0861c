"""Certificates: passing and failing verdicts on fabricated measurements; accepted targets; output."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

import phasebench as pb
from phasebench.benchmarks.certificate import certificate, measures
from phasebench.benchmarks.certificate.certificate import certify
from phasebench.benchmarks.certificate.render import document, write
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.checks import structure
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.judge.judge import judgements, offers, verdict
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNJUDGED
from phasebench.benchmarks.measure.coefficients import own_step
from phasebench.integrators.errors import InvalidInput
from support.commands import call
from support.evidence import order_row, part


def tables(**rows) -> Tables:
    """Fabricated measurements of a correct step (tables of rows), some of them replaced."""
    good = {
        "runs": [{"on": "pendulum", "status": "ok", "reason": ""}],
        "state": [{"on": "pendulum", "what": "the same step twice", "value": 0.0}],
        "input": [{"on": "pendulum", "value": 0.0, "later": 0.0}],
        "order": [order_row(), order_row("tao", separable=False)],
    }
    return Tables(good | rows)


def of(name, claims, found: Tables):
    """The certificate's judgement of the claim or requirement ``name``, from the measurements ``found``."""
    return next(j for j in judgements(claims, found) if j.name == name)


def outcome(claims, found: Tables) -> str:
    """The certificate's overall verdict on these claims, from the measurements ``found``."""
    return verdict(judgements(claims, found))


def test_pass_needs_a_claim_and_every_verdict():
    assert outcome({"order": 2}, tables()) == "pass"
    assert outcome({}, tables()) == "not-judged"
    assert outcome({"order": 2, "symplectic": True}, tables()) == "not-judged", "it was not measured"
    assert outcome({"order": 3}, tables()) == "fail"
    assert outcome({"energy": "none"}, tables()) == "not-judged", "it claims nothing"


@pytest.mark.parametrize("missing", ["runs", "state", "input", "order"])
def test_missing_measurement_does_not_pass(missing):
    assert outcome({"order": 2}, tables(**{missing: []})) == "not-judged"


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("runs", {"runs": [{"on": "tao", "status": "raised", "reason": "line 3"}]}),
        ("runs", {"runs": [{"on": "tao", "status": "diverged", "reason": ""}]}),
        ("stateless", {"state": [{"on": "tao", "what": "steps in turns", "value": 1e-9}]}),
        ("stateless", {"state": [{"on": "tao", "what": "steps in turns", "value": 2e-13}]}),
        ("pure", {"input": [{"on": "tao", "value": 1e-16, "later": 0.0}]}),
        ("pure", {"input": [{"on": "tao", "value": 0.0, "later": 1e-16}]}),
        ("consistent", {"order": [order_row(terms=(1.0, 1e-17))]}),
        ("consistent", {"order": [order_row(terms=(2e-13, 1e-17))]}),
    ],
)
def test_unclaimed_requirements_are_judged(name, rows):
    found = of(name, {"order": 2}, tables(**rows))
    assert found.verdict == CONTRADICTED
    assert outcome({}, tables(**rows)) == "fail", "also where nothing is claimed"
    assert of(name, {}, tables()).verdict == HOLDS


def test_exception_in_a_later_measurement_is_reported():
    found = tables()
    found.failed["raised"] = "step 700 on dimer"
    assert of("runs", {}, found).verdict == CONTRADICTED
    assert outcome({"order": 2}, found) == "fail"


def test_inconsistent_step_has_no_structure():
    found = tables(
        order=[order_row(terms=(1.0, 1e-17))], symplectic=[{"on": "tao", "value": 0.0, "floor": 1e-13, "own": 0.1}]
    )
    assert of("symplectic", {"symplectic": True}, found).verdict == UNJUDGED
    assert of("symplectic", {"symplectic": False}, found).verdict == UNJUDGED


@pytest.mark.parametrize(
    ("orders", "claimed", "expected"),
    [
        ((2.0, 2.05), 2, HOLDS),
        ((2.0, 4.0), 2, HOLDS),  # the symmetry of one system may raise the order
        ((4.0, 4.0), 2, CONTRADICTED),
        ((1.0, 2.0), 2, CONTRADICTED),
        ((1.5, 1.5), 2, UNJUDGED),
        ((2.0, 1.5), 2, UNJUDGED),  # no evidence on a system that is not T + V
        ((float("nan"), 2.0), 2, UNJUDGED),
    ],
)
def test_order_on_the_worst_system_decides(orders, claimed, expected):
    rows = [order_row("pendulum", orders[0]), order_row("tao", orders[1], separable=False)]
    assert of("order", {"order": claimed}, tables(order=rows)).verdict == expected


def test_truncated_coefficients_contradict_an_order():
    assert of("order", {"order": 2}, tables(order=[order_row(terms=(1e-17, 1e-11))])).verdict == CONTRADICTED
    assert of("order", {"order": 2}, tables(order=[order_row(terms=(1e-17, 1e-15))])).verdict == HOLDS


@pytest.mark.parametrize(
    ("constant", "doubt", "expected"),
    [
        (1e-15, 1e-14, HOLDS),
        (1e-10, 1e-12, CONTRADICTED),
        (1e-10, 1e-9, HOLDS),
        (1.0, 1e-3, CONTRADICTED),
        (0.002, 0.01, UNJUDGED),
    ],
)
def test_consistency_in_double_precision(constant, doubt, expected):
    row = {k: v for k, v in order_row().items() if k not in ("terms", "clean")}
    found = of("consistent", {}, tables(order=[row | {"constant": constant, "doubt": doubt}]))
    assert found.verdict == expected
    assert (expected != HOLDS) or "smaller could not be seen" in found.why


def test_consistency_needs_every_system():
    silent = {k: v for k, v in order_row("tao").items() if k not in ("terms", "clean")}
    assert of("consistent", {}, tables(order=[order_row(), silent])).verdict == UNJUDGED


def test_structure_holds_only_if_seen_on_every_system():
    kept = {"on": "pendulum", "value": 1e-16, "floor": 1e-13, "own": 1e-2, "h": 0.5, "separable": True}
    broken = kept | {"on": "tao", "value": 1e-3, "separable": False}
    unseen = kept | {"on": "tao", "own": 1e-12}
    failed = {"on": "tao", "status": "failed", "reason": "with -h: no"}
    for claimed, rows, expected in (
        (True, [kept], HOLDS),
        (True, [kept, broken], CONTRADICTED),
        (True, [kept, unseen], UNJUDGED),
        (True, [kept, failed], UNJUDGED),
        (False, [kept, broken], HOLDS),
        (False, [kept], CONTRADICTED),
        (False, [kept, unseen], UNJUDGED),
    ):
        assert of("symplectic", {"symplectic": claimed}, tables(symplectic=rows)).verdict == expected
    worse = broken | {"value": 2e-3, "h": 0.25, "on": "coupled"}
    hinted = of("symplectic", {"symplectic": True}, tables(symplectic=[kept, broken, worse]))
    assert hinted.why.startswith("a defect of 2.0e-03 at h = 0.25 on coupled, floor 1e-13")
    assert hinted.on == ("tao", "coupled")
    assert "REQUIRES = ('separable',)" in hinted.why
    denied = of("symplectic", {"symplectic": False}, tables(symplectic=[kept, broken]))
    assert "REQUIRES" not in denied.why, "it is as is claimed: there is nothing to mend"
    assert structure("symplectic", True, tables(symplectic=[])).verdict == UNJUDGED


def long_row(value, slope=0.0):
    return {"on": "henon-heiles", "status": "ok", "reason": "", "energy": part(value, slope)}


def test_energy_is_preserved_bounded_or_drifts():
    preserved, bounded, drifts = long_row(1e-13), long_row(1e-4), long_row(1e-4, 2e-7)
    lost = {"on": "dimer", "status": "diverged", "reason": "after 3 steps"}
    for claimed, rows, expected in (
        ("preserved", [preserved], HOLDS),
        ("preserved", [preserved, bounded], CONTRADICTED),
        ("bounded", [preserved, bounded], HOLDS),
        ("bounded", [bounded, drifts], CONTRADICTED),
        ("bounded", [bounded, lost], UNJUDGED),
        ("drift", [bounded, drifts], HOLDS),
        ("drift", [bounded, preserved], CONTRADICTED),
    ):
        assert of("energy", {"energy": claimed}, tables(long=rows)).verdict == expected, (claimed, expected)
    assert of("bilinear", {"bilinear": "preserved"}, tables(long=[bounded])).verdict == UNJUDGED
    assert "energy=bounded" in offers({}, tables(long=[bounded]))
    assert "energy=preserved" in offers({}, tables(long=[preserved]))


def test_stability_without_a_measured_limit_is_not_judged():
    row = {"on": "harmonic-oscillator", "limit": 2.0, "scanned": 10.0, "reason": ""}
    for reason, expected in (("", HOLDS), ("no matrix", UNJUDGED)):
        found = of("stability", {"stability": 2.0}, tables(stability=[row | {"reason": reason}]))
        assert (found.verdict, found.why) == (expected, reason)


def test_adaptive_method_whose_error_does_not_fall_is_inconsistent():
    for errors, expected in (([1e-4, 2e-9], HOLDS), ([1e-4, 1e-4], CONTRADICTED)):
        row = {"on": "tao", "tolerances": [1e-4, 1e-10], "errors": errors}
        assert of("consistent", {}, tables(tolerance=[row], order=[])).verdict == expected


# -- targets ----------------------------------------------------------------------------------------------------------

LEAPFROG = {"a": [1], "b": ["1/2", 0.5]}
HEUN = {"A": [[0, 0], [1, 0]], "b": ["1/2", "1/2"]}
STEP = "def step(system, q, p, h):\n    return q, p\n"


def test_target_is_a_callable_a_file_coefficients_or_a_name(tmp_path, monkeypatch):
    (tmp_path / "mine_here.py").write_text(STEP + "def run(system, q, p, t_end, tol):\n    return q, p\n")
    (tmp_path / "c.json").write_text(json.dumps(LEAPFROG | {"claims": {"order": 2}}))
    monkeypatch.chdir(tmp_path)
    assert subject("mine_here:step").id == "mine_here:step"
    assert subject("mine_here:run").adaptive
    assert subject("./mine_here.py", {"order": 3}).own.claims == {"order": 3}
    assert subject("c.json").own.claims == {"order": 2}
    assert subject(LEAPFROG).own.requires == ("separable",)
    assert subject("rk4").own.claims["order"] == 4
    assert subject("heyoka").adaptive


@pytest.mark.parametrize(
    ("target", "claims", "said"),
    [
        ("leapfog", {}, "package.module:callable"),
        ("no_such_module_at_all:step", {}, "No module named"),
        ("math:pi", {}, "cannot be called"),
        ("./none.py", {}, "no file"),
        ("./none.json", {}, "cannot be read"),
        (3, {}, "give a path"),
        ({"a": [1], "b": ["x"]}, {}, "no number"),
        ({"a": [1], "b": [1, 2, 3]}, {}, "alternate"),
        ({"a": [1]}, {}, "for a splitting"),
        ({"A": [[0]], "b": [1, 2]}, {}, "2 rows"),
        (LEAPFROG | {"d": 1}, {}, "'d'"),
        (LEAPFROG, {"order": 2.5}, "positive integer"),
        (LEAPFROG, {"simplectic": True}, "did you mean symplectic"),
    ],
)
def test_invalid_target_is_refused(target, claims, said):
    with pytest.raises(InvalidInput, match=said):
        subject(target, claims)


def test_coefficients_define_a_step():
    for record, order in ((LEAPFROG, 2), (HEUN, 2), ({"A": [["1/2"]], "b": [1]}, 2), ({"a": [1], "b": [1]}, 1)):
        assert certify(own_step(record, "record"), {"order": order}, alone=True).verdict == "pass"
        assert certify(own_step(record, "record"), {"order": order + 1}, alone=True).verdict == "fail"


# -- output -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def claimed_alone(monkeypatch):
    """Measure claimed properties only; the command in the README measures all of them."""
    monkeypatch.setattr(measures, "EVERYTHING", set())


@pytest.mark.parametrize(("outcome", "code"), [("pass", 0), ("not-judged", 1), ("fail", 1)])
def test_exit_code_is_0_only_for_pass(monkeypatch, outcome, code):
    found = SimpleNamespace(verdict=outcome, as_dict=dict)
    monkeypatch.setattr(certificate, "certify", lambda *of, **more: found)
    assert call("validate", "./mine.py", "--json").exit_code == code


def test_exit_codes_and_json(tmp_path, claimed_alone):
    path = tmp_path / "leapfrog.json"
    path.write_text(json.dumps(HEUN))
    done = call("validate", str(path), "--claim", "order=2", "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == 0
    assert list(found)[:4] == ["integrator", "claims", "measured", "verdict"]
    assert found["verdict"] == "pass"
    assert all(list(c) == ["claim", "verdict", "measured", "interval", "on", "why"] for c in found["claims"])
    wrong = call("validate", str(path), "--claim", "order=3")
    assert wrong.exit_code == 1
    assert "contradicted" in wrong.stdout
    assert call("validate", "./none.py").exit_code == 2
    audit = call("audit", "--peer", "./mine.py")
    assert audit.exit_code == 2
    assert "phasebench validate ./mine.py" in audit.said


def test_certificate_is_reproducible_for_a_seed(tmp_path):
    texts = []
    for k, seed in enumerate((0, 0, 1)):
        found = certify(HEUN, {"order": 2}, seed=seed, alone=True)
        (path, *_) = write(found, tmp_path / str(k))
        whole = json.loads(path.read_text())
        assert whole.pop("seconds") > 0
        whole.pop("times")
        texts.append((json.dumps(whole), (tmp_path / str(k) / "certificate.html").read_bytes()))
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]
    assert "order 2" in (tmp_path / "0" / "certificate.md").read_text()


def test_unwritable_folder_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInput, match="cannot be written"):
        write(certify(HEUN, {"order": 2}, alone=True), tmp_path / "file" / "folder")


def test_python_interface_returns_a_table(claimed_alone):
    found = pb.validate(HEUN, order=2, requires="separable")
    frame = found.to_frame()
    assert list(frame.columns) == ["claim", "verdict", "measured", "interval", "on", "why"]
    assert found.verdict == frame.attrs["verdict"] == "pass"
    assert found.claims[-1].claim == frame["claim"].tolist()[-1] == found["claim"].tolist()[-1] == "order 2"
    assert len(found.plot("order").axes[0].lines) > 1
    with pytest.raises(InvalidInput, match="did you mean order"):
        found.plot("oder")
    with pytest.raises(InvalidInput, match="unknown argument ordr; did you mean order"):
        pb.validate(HEUN, ordr=2)


def test_document_begins_with_counts_of_verdicts():
    def sentence(claims, **rows):
        found = tables(**rows)
        verdicts = judgements(claims, found)
        args = ([], verdict(verdicts), found, "", (), 0, 1.0)
        return " ".join(document(certificate.Certificate("mine", verdicts, *args), []).split("##")[0].split())

    assert "All 5 claims and requirements hold." in sentence({"order": 2})
    assert "All 4 claims and requirements hold. Nothing was claimed" in sentence({})
    wrong = sentence({"order": 3, "symplectic": True})
    assert "Of 6 claims and requirements 4 hold, 1 contradicted, 1 not judged." in wrong
    assert "Contradicted: order 3: it is 2 on " in wrong


def test_narrow_output_has_one_line_per_claim(tmp_path, monkeypatch, claimed_alone):
    path = tmp_path / "heun.json"
    path.write_text(json.dumps(HEUN))
    for columns, whole in (("40", True), ("", True), ("120", False)):
        monkeypatch.setenv("COLUMNS", columns)
        lines = call("validate", str(path), "--claim", "order=3").stdout.splitlines()
        assert any(line.startswith("  order 3: contradicted (") for line in lines) is whole
        assert any("contradicted" in line for line in lines)


def test_unwritable_folder_is_refused_before_measuring(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(certificate, "certify", lambda *_: pytest.fail("it was measured"))
    done = call("validate", "rk4", "--output", str(tmp_path / "file"))
    assert done.exit_code == 2
    assert "cannot be written" in done.stderr
