"""Certified states: stored ones are exact and tied to their problem, each false statement is found; the command."""

from __future__ import annotations

import json
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import labels, problem
from phasebench.benchmarks.studies import references
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.certificates import check, horizon, make, others, stored
from phasebench.reference.certificates.along import Precision, along
from phasebench.reference.solvers import gauss, taylor
from phasebench.reference.solvers.exact import exact
from support.commands import call

#: Orbit -> whether its horizon is before its end.
HORIZONS = {
    **dict.fromkeys(("henon-heiles:chaotic", "quadrupole-boson:h20", "double-pendulum:chaotic", "fpu", "n-body"), True),
    **dict.fromkeys(("harmonic-oscillator", "kepler", "henon-heiles:box", "double-pendulum:regular"), False),
}
#: From this number of degrees of freedom on only the last state is checked.
MANY = 20
#: The orbit for the tests of checks: unstable, and cheap.
ORBIT = "schwarzschild:photon-sphere"


def halves(z):
    """(q, p) of a state z = (q, p)."""
    return z[: len(z) // 2], z[len(z) // 2 :]


def spoilt(text: str, place: int = 20) -> str:
    """Return a decimal string with one decimal, the 20th or the one at ``place``, changed by 5."""
    at = text.index(".") + place
    return f"{text[:at]}{(int(text[at]) + 5) % 10}{text[at + 1 :]}"


# -- what is stored ---------------------------------------------------------------------------------------------------


def off_manifold(made) -> float:
    """The largest hidden constraint at the start, which is made of doubles: H changes by about that a unit of time."""
    if not made.system.constrained:
        return 0.0
    with mpmath.workdps(50):
        return float(max(abs(x) for x in stored.evaluate(made, made.system.hidden, made.q0, made.p0)))


@pytest.mark.parametrize("label", labels())
def test_every_orbit_has_a_valid_reference(label):
    """If it fails for a new problem: give its orbits their times and run the command in the message."""
    made, known = problem(label), stored.find(problem(label))
    assert tuple(e.t for e in known.ends) == made.start.times, f"phasebench certify {label} --update"
    assert known.digits_horizon == known.t_end, "the stored digits do not hold to the end"
    assert known.bits >= 200
    assert [e.uncertainty for e in known.ends] == sorted(e.uncertainty for e in known.ends)
    for state in known.ends if made.system.d < MANY else known.ends[-1:]:
        assert state.agree, state.checks
        assert state.uncertainty < 1e-3 * state.long_double
        assert abs(stored.energy_change(made, state.q_text, state.p_text)) < 1e-25 + state.t * off_manifold(made)
    if label in HORIZONS:
        assert (0 < known.horizon < known.t_end, known.rate is not None) == (HORIZONS[label],) * 2


@pytest.mark.parametrize("label", ["henon-heiles:chaotic", "lotka-volterra:4-2"])
def test_control_the_energy_shows_one_wrong_digit(label):
    made = problem(label)
    z = list(stored.load(made)[-1].texts)
    with mpmath.workdps(50):
        slopes = stored.evaluate(made, [made.system.H.diff(x) for x in (*made.system.q, *made.system.p)], *halves(z))
    i = int(np.argmax([abs(float(s) * float(x)) for s, x in zip(slopes, z, strict=True)]))
    z[i] = spoilt(z[i])
    assert abs(stored.energy_change(made, *halves(z))) > 1e-25


@pytest.mark.parametrize("label", ["harmonic-oscillator", "kepler"])
def test_digits_equal_the_exact_solution(label):
    made = problem(label)
    ends = stored.load(made)
    with mpmath.workdps(50):
        for state, q, p in zip(ends, *exact(made, [e.t for e in ends], 45), strict=True):
            error = max(abs(mpmath.mpf(x) - y) for x, y in zip(state.texts, (*q, *p), strict=True))
            assert error < state.uncertainty < 1e-25


def test_the_change_of_energy_is_relative_to_its_terms():
    made = problem("harmonic-oscillator")
    assert stored.energy_change(made, ["2"], ["0"]) == pytest.approx((2 - 0.5) / 2)
    assert stored.energy_change(made, ["0.5"], ["0.5"]) == pytest.approx((0.25 - 0.5) / 0.5)


# -- look-up ----------------------------------------------------------------------------------------------------------


def test_a_state_is_found_by_exact_time_and_parameters():
    made, other = problem("kepler"), problem("kepler", e=0.5)
    assert stored.end(made, 1.0).t == 1.0
    assert stored.end(made, np.nextafter(1.0, 2.0)) is None
    assert stored.end(other, 1.0) is None
    with pytest.raises(InvalidInput, match=r"no reference of kepler at e = 0\.5"):
        stored.load(other)
    with pytest.raises(InvalidInput, match="certify kepler --update"):
        stored.load(made, "nowhere")


def test_a_changed_problem_is_refused():
    made = problem("kepler")
    orbit, s = made.start, made.system
    with pytest.raises(InvalidInput, match="initial data of kepler are no longer"):
        stored.load(replace(made, orbits=(replace(orbit, q=(np.nextafter(orbit.q[0], 1), 0.0)),)))
    mass = Hamiltonian(q=s.q, p=s.p, H=s.H + s.p[0] ** 2 / 1000)
    with pytest.raises(InvalidInput, match="formulae of kepler are no longer"):
        stored.load(replace(made, system=mass))
    same = Hamiltonian(q=s.q, p=s.p, H=s.H.expand())
    assert stored.load(replace(made, system=same)) == stored.load(made)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A temporary folder with kepler.json, used by the commands."""
    (tmp_path / "kepler.json").write_text((stored.DIRECTORY / "kepler.json").read_text())
    monkeypatch.setattr(stored, "DIRECTORY", tmp_path)
    return tmp_path


def rewritten(change):
    """Function that changes the content of a file, a dict, and updates its checksum."""

    def rewrite(path):
        content = json.loads(path.read_text())
        content.pop("sha256")
        change(content, content["references"][0]["ends"][0])
        path.write_text(json.dumps(content | {"sha256": stored._digest(content)}))

    return rewrite


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: path.write_text(path.read_text()[:-500]), "no JSON"),
        (lambda path: path.write_bytes(b"\xff\xfe"), "no JSON"),
        (lambda path: path.write_text("[]"), "no file of format"),
        (lambda path: path.write_text(path.read_text().replace('"uncertainty": ', '"uncertainty": 1', 1)), "checksum"),
        (rewritten(lambda all, end: all.update(problem="pendulum")), "of the problem 'pendulum'"),
        (rewritten(lambda all, end: end.pop("t")), "cannot be read"),
        (rewritten(lambda all, end: end["q_text"].__setitem__(0, "half")), "cannot be read"),
        (rewritten(lambda all, end: end["q_text"].pop()), "cannot be read"),
    ],
)
def test_a_damaged_file_is_refused(folder, damage, message):
    path = folder / "kepler.json"
    damage(path)
    with pytest.raises(InvalidInput, match=message) as caught:
        stored.end(problem("kepler"), 1.0)
    assert str(path) in str(caught.value)
    assert "phasebench certify kepler --update" in str(caught.value)


# -- false statements -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measurements():
    """The measurements of an orbit from which its certificate is checked, computed once for all tests."""
    made, known = problem(ORBIT), stored.find(problem(ORBIT))
    path = along(made, [e.t for e in known.ends], check.AGAIN)
    said = others.words(made, made.start.times, path, horizon.neighbour(made, path.grid, path.near))
    return path, horizon.rounding(made, path.grid, horizon.OTHER), said


@pytest.fixture
def measured(measurements, monkeypatch):
    """Let the check of a certificate use the measurements already made; the certificate."""
    path, rounding, said = measurements
    monkeypatch.setattr(check, "along", lambda *a: path)
    monkeypatch.setattr(horizon, "rounding", lambda *a: rounding)
    monkeypatch.setattr(others, "words", lambda *a: said)
    return stored.find(problem(ORBIT))


def at_end(**changed):
    """Function that returns a certificate with fields of its last state changed: name=function of the state."""
    return lambda c: replace(
        c, ends=(*c.ends[:-1], replace(c.ends[-1], **{k: f(c.ends[-1]) for k, f in changed.items()}))
    )


def digit(place: int):
    """Function that returns a certificate with one decimal of q1 in its last state changed by 5."""
    return at_end(q_text=lambda end: (spoilt(end.q_text[0], place), *end.q_text[1:]))


def later(name: str, points: float):
    """Function that returns a certificate with a time of it (``name``) moved by some grid points."""
    return lambda c: replace(c, **{name: getattr(c, name) + points * c.spacing})


CHANGES = {
    "a digit": (digit(20), "digits are off"),
    "the last digit that is known": (digit(22), "digits are off"),
    "a tenth of the uncertainty": (at_end(uncertainty=lambda e: e.uncertainty / 10), "is stated"),
    "3000 uncertainties": (at_end(uncertainty=lambda e: 3000 * e.uncertainty), "is stated"),
    "a later horizon": (later("horizon", 4), "horizon is stated"),
    "an earlier horizon": (later("horizon", -4), "horizon is stated"),
    "the interval's begin": (later("earliest", -4), "earliest is stated"),
    "the interval's end": (later("latest", 4), "latest is stated"),
    "the limit": (lambda c: replace(c, limit=1e-11), "the limit is stated"),
    "other times": (lambda c: replace(c, ends=c.ends[1:]), "the orbit's times are"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_certificate_does_not_hold(measured, what):
    change, says = CHANGES[what]
    if what == "other times":
        wrong = tuple(check._times(problem(ORBIT), [e.t for e in change(measured).ends]))
    else:
        outcome = check.examine(problem(ORBIT), change(measured))
        wrong = outcome.wrong
        assert not outcome.holds
    assert len(wrong) == 1
    assert says in wrong[0]


def test_an_unchanged_certificate_holds(measured, tmp_path, monkeypatch):
    """Control; and command and cell fail where a file, which is not damaged, states something false."""
    assert check.examine(problem(ORBIT), measured).holds
    all_of, versions = stored.read("schwarzschild")
    changed = [CHANGES["a later horizon"][0](c) if c.problem == ORBIT else c for c in all_of]
    monkeypatch.setattr(stored, "DIRECTORY", tmp_path / "some" / "where")
    for certificates, code in ((all_of, 0), (changed, 1)):
        stored.write("schwarzschild", certificates, versions)
        done = call("certify", ORBIT, "--json")
        (found,) = json.loads(done.stdout)["references"]
        assert (done.exit_code, bool(found["changed"])) == (code, bool(code))
    assert "stated" in references.stored_states(ORBIT)["changed"]


@pytest.mark.parametrize(
    ("distance", "uncertainty", "compares", "agrees"),
    [
        (2.6e-3, 2.4, False, False),  # IAS15 on the chaotic Henon-Heiles orbit at t = 300
        (1e-3, 0.05, False, False),
        (1e-3, 0.007, True, True),
        (0.5, 0.007, True, False),
        (1.01e-15, 1e-15, True, False),
        (0.99e-15, 1e-15, True, True),
        (1e-20, 0.0, True, True),
        (1.1e-20, 0.0, True, False),
        (0.0, float("nan"), False, False),
    ],
)
def test_a_solver_without_two_digits_neither_agrees_nor_disagrees(distance, uncertainty, compares, agrees):
    said, good = stored.Check("another", distance, uncertainty), stored.Check("good", 0.0, 0.0)
    state = stored.End(1.0, ("0.78",), ("0.1",), 1e-20, 1e-15, 0.0, (said,))
    assert (state.compares(said), state.agrees(said), state.agree) == (compares, agrees, agrees)
    assert replace(state, checks=(said, good)).agree == (agrees or not compares)


def outcome(known, **changed):
    """The result of rechecking a certificate in which everything holds, with some fields changed."""
    span = horizon.Span(known.horizon, known.earliest, known.latest)
    errors = tuple(e.uncertainty / 4 for e in known.ends)
    told = check.Outcome(known, errors, span, known.t_end, known.ends[-1].long_double, known.growth, known.rate, ())
    return replace(told, **changed)


def test_the_row_of_a_reference():
    """Of four states the first has lost energy and the second has a check of too few digits; the last disagrees."""
    known = stored.find(problem("kepler"))
    a, b, c, d = known.ends
    vague, wrong = stored.Check("vague", 1e-15, 0.5), stored.Check("wrong", 1.0, 1e-10)
    ends = (replace(a, energy=-1e-3), replace(b, checks=(vague,)), c, replace(d, checks=(*d.checks, wrong)))
    told = outcome(
        replace(known, ends=ends),
        errors=tuple(e.uncertainty / n for e, n in zip(ends, (8, 2, 4, 0), strict=True) if n) + (0.0,),
    )
    found = told.row()
    assert (found["least bound"], found["largest bound"]) == (pytest.approx(2.0), float("inf"))
    assert (found["energy"], found["no comparison"], found["unchecked"], found["disagree"]) == (1e-3, 1, 1, 1)
    assert found["pairs"] == sum(len(e.checks) for e in known.ends) - len(b.checks) + 1
    assert not told.holds
    assert outcome(known).row()["disagree"] == 0


def test_how_long_the_digits_hold_and_what_has_moved():
    known = stored.find(problem("kepler"))
    for k, holds in enumerate((0.0, *(e.t for e in known.ends[:-1]))):
        ends = list(known.ends)
        ends[k] = replace(ends[k], uncertainty=1.1 * known.limit * ends[k].size)
        assert replace(known, ends=tuple(ends)).digits_horizon == holds
    last = known.ends[-1]
    moved = replace(
        known, ends=(*known.ends[:-1], replace(last, q_text=(spoilt(last.q_text[0], 29), *last.q_text[1:])))
    )
    assert check.describe_change(None, known) == "new"
    assert check.describe_change(known, known) == ""
    assert check.describe_change(known, moved) == f"t = {last.t:g} by 5e-30"
    assert check.describe_change(replace(known, ends=known.ends[:2]), known) == "at other times"
    start = replace(problem("kepler").start, times=())
    with pytest.raises(InvalidInput, match="states no times"):
        check.renew(replace(problem("kepler"), orbits=(start,)))
    with pytest.raises(InvalidInput, match="no reference of kepler is stored"):
        check.recheck(problem("kepler", e=0.5))


# -- new certificates -------------------------------------------------------------------------------------------------


@pytest.mark.processor
def test_a_new_certificate_agrees_with_the_stored_one():
    made = problem("pendulum:swinging")
    new, old = make.certify(made, [1.0, 10.0], grid_points=20), stored.find(made)
    for end in new.ends:
        known = old.at(end.t)
        assert stored.distance(known.texts, end.texts) <= known.uncertainty + end.uncertainty < 1e-30
        assert all(len(x.partition("e")[0].lstrip("-").replace(".", "")) == stored.DIGITS for x in end.texts)
        assert end.agree
    assert (new.t_end, new.spacing, new.horizon, new.bits, new.limit) == (10.0, 0.5, 10.0, old.bits, old.limit)
    same = ("problem", "orbit", "parameters", "q0", "p0", "fingerprint")
    assert [getattr(new, x) for x in same] == [getattr(old, x) for x in same]


def test_control_a_second_solver_of_another_equation_disagrees(monkeypatch):
    """g/l = 1 + 1e-15, an error that only the long double of the second solver resolves."""
    right = gauss.right_hand_side

    def slightly_wrong(system):
        F, kinks = right(system)
        return lambda Y, signs: F(Y, signs) * np.array([[1], [1 + 1e-15]]), kinks

    monkeypatch.setattr(gauss, "right_hand_side", slightly_wrong)
    assert not make.certify(problem("pendulum:swinging"), [10.0], grid_points=20).ends[0].agree


def test_a_bound_has_its_margin_and_a_run_with_too_few_bits_is_refused():
    """Also refused: growth of round-off beyond the bits of the run."""
    made = problem(ORBIT)
    end = stored.load(made)[-1]
    few, many = (along(made, [end.t], p, 4) for p in (Precision(120, "1e-34"), make.PRECISION))
    (error,) = make.errors([end.texts], [end.t], many)
    (bound,) = make.uncertainties([end.texts], [end.t], many, [horizon.UNIT * 1e8])
    assert bound == pytest.approx(make.FACTOR * error + 1e8 * float(make.PRECISION.tolerance), rel=1e-9, abs=0)
    assert 2 * error <= bound <= 1e4 * error
    with pytest.raises(taylor.ReferenceFailed, match="120 bits may be off"):
        make.uncertainties([end.texts], [end.t], few, [1e-8])
    with pytest.raises(taylor.ReferenceFailed, match="needs more bits"):
        make.uncertainties([end.texts], [end.t], many, [1e14])


# -- the command ------------------------------------------------------------------------------------------------------


def test_the_command_reports_what_holds_and_what_does_not(monkeypatch):
    known = stored.find(problem("kepler"))

    def run(**changed):
        monkeypatch.setattr(check, "recheck", lambda made: outcome(known, **changed))
        done, told = call("certify", "kepler"), json.loads(call("certify", "kepler", "--json").stdout)
        return done.exit_code, done.stdout, told["references"][0]

    code, text, told = run()
    assert (code, told["problem"], told["changed"], told["least bound"]) == (0, "kepler", "", 4.0)
    assert "all that they state holds" in text
    code, text, told = run(wrong=("at t = 1 the digits are off",))
    assert (code, told["changed"]) == (1, "at t = 1 the digits are off")
    assert "wrong: kepler" in text
    for field, says in (({"distance": 1.0}, "disagree"), ({"uncertainty": 9.0}, "1 of 4 states without a comparison")):
        first = replace(known.ends[0], checks=(replace(known.ends[0].checks[0], **field),))
        code, text, _ = run(certificate=replace(known, ends=(first, *known.ends[1:])))
        assert code == 1
        assert says in text


def test_an_update_stores_each_valid_certificate_at_once(folder, monkeypatch):
    """The second problem is interrupted; the first has been stored already, over an unreadable file."""
    known, wrong = stored.find(problem("kepler")), []
    (folder / "kepler.json").write_text("{")

    def certify(made, times):
        if made.id == "fpu":
            raise KeyboardInterrupt
        return known

    monkeypatch.setattr(make, "certify", certify)
    monkeypatch.setattr(check, "examine", lambda made, new: outcome(new, wrong=tuple(wrong)))
    assert call("certify", "kepler", "fpu", "--update").exit_code != 0
    assert stored.find(problem("kepler")) == known
    assert [p.name for p in folder.iterdir()] == ["kepler.json"]
    wrong.append("horizon")
    monkeypatch.setattr(make, "certify", lambda made, times: replace(known, horizon=1.0))
    assert call("certify", "kepler", "--update").exit_code == 1
    assert stored.find(problem("kepler")) == known, "an invalid one is not stored"


def test_one_time_is_certified_and_printed():
    words = ("certify", "pendulum:swinging", "--t-end", "1")
    true = stored.end(problem("pendulum:swinging"), 1.0)
    done, content = call(*words), json.loads(call(*words, "--json").stdout)
    assert done.exit_code == 0
    assert true.q_text[0][:28] in done.stdout
    assert (content["problem"], content["t"]) == ("pendulum:swinging", 1.0)
    assert content["q"][0][:28] == true.q_text[0][:28]
    assert [c["agrees"] for c in content["checks"]] == [True], "by Gauss's method alone, as d is 1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["keplar"], "did you mean kepler"),
        (["henon-heiles:boxes"], "did you mean box"),
        (["pendulum", "kepler", "--t-end", "1"], "one problem"),
        (["harmonic-oscillator", "--t-end", "1e9", "--time-limit", "0.01"], "cannot be certified to 1e+09"),
    ],
)
def test_invalid_arguments_of_the_command(arguments, message):
    done = call("certify", *arguments)
    assert done.exit_code == 2
    assert message in done.stderr
