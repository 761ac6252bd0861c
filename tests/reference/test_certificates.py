"""Certified references: one stored for every orbit, exact to 25 digits in the energy, and tied to its problem."""

from __future__ import annotations

import json
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import PROBLEMS, labels, problem
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.certificates import check, horizon, make, stored
from phasebench.reference.solvers import gauss, taylor
from phasebench.reference.solvers.exact import exact
from support.references import spoilt

UNSTABLE = ("henon-heiles:chaotic", "quadrupole-boson:h20", "double-pendulum:chaotic", "fpu", "n-body")
REGULAR = ("harmonic-oscillator", "kepler", "henon-heiles:box", "double-pendulum:regular")
#: From this number of degrees of freedom on only the last state is checked.
MANY = 20


def largest(made, state) -> int:
    """Index of the component of (q, p) with the largest effect on the energy."""
    z = (*state.q_text, *state.p_text)
    with mpmath.workdps(50):
        slopes = stored.evaluate(made, [made.system.H.diff(x) for x in (*made.system.q, *made.system.p)], *halves(z))
    return int(np.argmax([abs(float(s) * float(x)) for s, x in zip(slopes, z, strict=True)]))


def off_manifold(made) -> float:
    """The largest hidden constraint at the start, which is made of doubles: H changes by about that a unit of time."""
    if not made.system.constrained:
        return 0.0
    with mpmath.workdps(50):
        return float(max(abs(x) for x in stored.evaluate(made, made.system.hidden, made.q0, made.p0)))


def halves(z):
    """(q, p) of a state z = (q, p)."""
    return z[: len(z) // 2], z[len(z) // 2 :]


# -- what is stored ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("label", labels())
def test_every_orbit_has_a_valid_reference(label):
    """If it fails for a new problem: give its orbits their times and run the command in the message."""
    made = problem(label)
    ends = stored.load(made)
    assert tuple(e.t for e in ends) == made.start.times, f"phasebench certify {label} --update"
    found = stored.find(made)
    assert found.digits_horizon == found.t_end, "the stored digits do not hold to the end"
    for state in ends if made.system.d < MANY else ends[-1:]:
        assert state.agree, state.checks
        assert state.uncertainty < 1e-3 * state.long_double
        assert abs(stored.energy_change(made, state.q_text, state.p_text)) < 1e-25 + state.t * off_manifold(made)


@pytest.mark.parametrize("label", ["kepler", "henon-heiles:chaotic", "lotka-volterra:4-2", "outer-solar-system"])
def test_control_the_energy_shows_one_wrong_digit(label):
    made = problem(label)
    state = stored.load(made)[-1]
    z = [*state.q_text, *state.p_text]
    i = largest(made, state)
    z[i] = spoilt(z[i])
    assert abs(stored.energy_change(made, *halves(z))) > 1e-25


@pytest.mark.parametrize("label", ["harmonic-oscillator", "kepler"])
def test_digits_equal_the_exact_solution(label):
    made = problem(label)
    ends = stored.load(made)
    with mpmath.workdps(50):
        Q, P = exact(made, [e.t for e in ends], 45)
        for state, q, p in zip(ends, Q, P, strict=True):
            pairs = zip((*state.q_text, *state.p_text), (*q, *p), strict=True)
            error = max(abs(mpmath.mpf(x) - y) for x, y in pairs)
            assert error < state.uncertainty < 1e-25


@pytest.mark.parametrize("label", ["pendulum:rotating", "kepler", "lotka-volterra:4-2", "duffing:both-wells"])
def test_a_run_in_doubles_agrees_with_the_stored_states(label):
    made = problem(label)
    early = [e for e in stored.load(made) if e.t <= 10]
    rows = taylor.states(made.system, float, made.q0, made.p0, [e.t for e in early])
    for row, state in zip(rows, early, strict=True):
        z = np.concatenate([state.q, state.p])
        assert np.abs(row - z).max() < 1e-12
        assert np.abs(row - z * (1 + 1e-10)).max() > 1e-12


@pytest.mark.parametrize("label", UNSTABLE)
def test_the_horizon_of_an_unstable_orbit_is_before_its_end(label):
    found = stored.find(problem(label))
    assert 0 < found.horizon < found.t_end
    assert found.rate > 0


@pytest.mark.parametrize("label", REGULAR)
def test_the_horizon_of_a_regular_orbit_is_its_end(label):
    found = stored.find(problem(label))
    assert (found.horizon, found.rate) == (found.t_end, None)


# -- look-up ----------------------------------------------------------------------------------------------------------


def test_a_state_is_found_by_exact_time_and_parameters():
    made = problem("kepler")
    state = stored.end(made, 1.0)
    assert state.t == 1.0
    assert stored.end(made, np.nextafter(1.0, 2.0)) is None
    other = problem("kepler", e=0.5)
    assert stored.end(other, 1.0) is None
    with pytest.raises(InvalidInput, match=r"no reference of kepler at e = 0\.5"):
        stored.load(other)
    with pytest.raises(InvalidInput, match="certify kepler --update"):
        stored.load(made, "nowhere")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A temporary folder with kepler.json, used by the commands."""
    original = stored.DIRECTORY / "kepler.json"
    (tmp_path / "kepler.json").write_text(original.read_text())
    monkeypatch.setattr(stored, "DIRECTORY", tmp_path)
    return tmp_path


def rewrite(path, change) -> None:
    """Change the content of a file and update its checksum."""
    content = json.loads(path.read_text())
    content.pop("sha256")
    change(content)
    path.write_text(json.dumps(content | {"sha256": stored._digest(content)}))


def without_time(content):
    """Remove the time of a state from a certificate's content."""
    del content["references"][0]["ends"][0]["t"]


def with_word(content):
    """Replace a number of a certificate's content by a word."""
    content["references"][0]["ends"][0]["q_text"][0] = "half"


def with_too_few(content):
    """Remove a component of a state from a certificate's content."""
    content["references"][0]["ends"][0]["q_text"].pop()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: path.write_text(path.read_text()[:-500]), "no JSON"),
        (lambda path: path.write_bytes(b"\xff\xfe"), "no JSON"),
        (lambda path: path.write_text("[]"), "no file of format"),
        (lambda path: path.write_text(path.read_text().replace('"uncertainty": ', '"uncertainty": 1', 1)), "checksum"),
        (lambda path: rewrite(path, lambda c: c.update(problem="pendulum")), "of the problem 'pendulum'"),
        (lambda path: rewrite(path, without_time), "cannot be read"),
        (lambda path: rewrite(path, with_word), "cannot be read"),
        (lambda path: rewrite(path, with_too_few), "cannot be read"),
    ],
)
def test_a_damaged_file_is_refused(folder, damage, message):
    path = folder / "kepler.json"
    damage(path)
    with pytest.raises(InvalidInput, match=message) as caught:
        stored.end(problem("kepler"), 1.0)
    assert str(path) in str(caught.value)
    assert "phasebench certify kepler --update" in str(caught.value)


def test_a_changed_problem_is_refused():
    made = problem("kepler")
    orbit = made.start
    with pytest.raises(InvalidInput, match="initial data of kepler are no longer"):
        stored.load(replace(made, orbits=(replace(orbit, q=(np.nextafter(orbit.q[0], 1), 0.0)),)))
    s = made.system
    mass = Hamiltonian(q=s.q, p=s.p, H=s.H + s.p[0] ** 2 / 1000)
    with pytest.raises(InvalidInput, match="formulae of kepler are no longer"):
        stored.load(replace(made, system=mass))
    same = Hamiltonian(q=s.q, p=s.p, H=s.H.expand())
    assert stored.load(replace(made, system=same)) == stored.load(made)


# -- new certificates -------------------------------------------------------------------------------------------------


@pytest.mark.processor
def test_a_new_certificate_agrees_with_the_stored_one():
    for new in make.certify(problem("pendulum:swinging"), [1.0, 10.0], grid_points=20).ends:
        old = stored.end(problem("pendulum:swinging"), new.t)
        assert stored.distance(old.texts, new.texts) <= old.uncertainty + new.uncertainty < 1e-30
        assert new.agree


def test_control_a_second_solver_of_another_equation_disagrees(monkeypatch):
    """g/l = 1 + 1e-15, an error that only the long double of the second solver resolves."""
    right = gauss.right_hand_side

    def slightly_wrong(system):
        F, kinks = right(system)
        return lambda Y, signs: F(Y, signs) * np.array([[1], [1 + 1e-15]]), kinks

    monkeypatch.setattr(gauss, "right_hand_side", slightly_wrong)
    found = make.certify(problem("pendulum:swinging"), [10.0], grid_points=20)
    assert not found.ends[0].agree


@pytest.mark.processor
@pytest.mark.parametrize("label", ["kepler", "quadrupole-boson:benchmark", "lotka-volterra-log:4-8"])
def test_gauss_is_exact_to_long_double(label):
    """Constants such as 2**(1/2) and 1/3 must not be rounded to doubles, an error of 1e-16."""
    made = problem(label)
    long, quad = taylor.extended_types()
    ends = taylor.step_ends(made.system, long, made.q0, made.p0, 2.0)
    found = gauss.run(made.system, made.q0, made.p0, [x / 2 for x in ends] + ends, [2.0])[0]
    truth = taylor.states(made.system, quad, made.q0, made.p0, [2.0])[0]
    assert max(abs(float(quad(a) - b)) for a, b in zip(found, truth, strict=True)) < 3e-18 * max(map(abs, found))


# -- the command ------------------------------------------------------------------------------------------------------


def run(*arguments):
    """(exit code, stdout) of `phasebench certify`."""
    done = CliRunner().invoke(app, ["certify", *arguments])
    assert done.exception is None or isinstance(done.exception, (SystemExit, KeyboardInterrupt)), done.exception
    return done.exit_code, done.stdout


def outcome(known, **changed):
    """The result of rechecking a certificate in which everything holds, with some fields changed."""
    span = horizon.Span(known.horizon, known.earliest, known.latest)
    errors = tuple(e.uncertainty / 4 for e in known.ends)
    told = check.Outcome(known, errors, span, known.t_end, known.ends[-1].long_double, known.growth, known.rate, ())
    return replace(told, **changed)


@pytest.fixture
def set_recheck(monkeypatch):
    """Function that sets the result of rechecking kepler's certificate."""

    def give(**changed):
        told = outcome(stored.find(problem("kepler")), **changed)
        monkeypatch.setattr(check, "recheck", lambda made: told)
        return told

    return give


def test_the_command_reports_what_holds_and_what_does_not(set_recheck):
    known = set_recheck().certificate
    code, text = run("kepler")
    assert code == 0
    assert "all that they state holds" in text
    set_recheck(wrong=("at t = 1 the digits are off by 2, and 1 is stated",))
    code, text = run("kepler")
    assert code == 1
    assert "wrong: kepler" in text
    assert "the digits are off by 2" in text
    for check_of, says in (
        ({"distance": 1.0}, "disagree"),
        ({"uncertainty": 9.0}, "1 of 4 states without a comparison"),
    ):
        spoilt_end = replace(known.ends[0], checks=(replace(known.ends[0].checks[0], **check_of),))
        set_recheck(certificate=replace(known, ends=(spoilt_end, *known.ends[1:])))
        code, text = run("kepler")
        assert code == 1
        assert says in text


def test_the_command_as_json(set_recheck):
    for wrong, code in (((), 0), (("the limit",), 1)):
        set_recheck(wrong=wrong)
        said, text = run("kepler", "--json")
        (row,) = json.loads(text)["references"]
        assert (said, row["problem"], row["changed"]) == (code, "kepler", "".join(wrong))
        assert row["least bound"] == row["largest bound"] == 4.0


def test_an_update_stores_each_problem_at_once(folder, monkeypatch):
    """The second problem is interrupted; the first has been stored already, over an unreadable file."""
    known = stored.find(problem("kepler"))
    (folder / "kepler.json").write_text("{")

    def certify(made, times):
        if made.id == "fpu":
            raise KeyboardInterrupt
        return known

    monkeypatch.setattr(make, "certify", certify)
    monkeypatch.setattr(check, "examine", lambda made, new: outcome(new))
    code, _ = run("kepler", "fpu", "--update")
    assert code != 0
    assert stored.find(problem("kepler")) == known
    assert [p.name for p in folder.iterdir()] == ["kepler.json"]


def test_an_update_does_not_store_an_invalid_certificate(folder, monkeypatch):
    known = stored.find(problem("kepler"))
    monkeypatch.setattr(make, "certify", lambda made, times: replace(known, horizon=1.0))
    monkeypatch.setattr(check, "examine", lambda made, new: outcome(new, wrong=("horizon",)))
    code, _ = run("kepler", "--update")
    assert code == 1
    assert stored.find(problem("kepler")) == known


def test_one_time_is_certified_and_printed():
    code, text = run("pendulum:swinging", "--t-end", "1")
    true = stored.end(problem("pendulum:swinging"), 1.0)
    assert code == 0
    assert true.q_text[0][:28] in text
    assert "agrees" in text
    code, text = run("pendulum:swinging", "--t-end", "1", "--json")
    content = json.loads(text)
    assert (code, content["problem"], content["t"]) == (0, "pendulum:swinging", 1.0)
    assert content["q"][0][:28] == true.q_text[0][:28]
    assert [c["agrees"] for c in content["checks"]] == [True], "by Gauss's method alone, as d is 1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["keplar"], "did you mean kepler"),
        (["henon-heiles:boxes"], "did you mean box"),
        (["pendulum", "kepler", "--t-end", "1"], "one problem"),
        (["kepler", "--t-end", "-1"], "must be a positive number"),
        (["kepler", "--t-end", "nan"], "must be a finite number"),
    ],
)
def test_invalid_arguments_of_the_command(arguments, message):
    done = CliRunner().invoke(app, ["certify", *arguments])
    assert done.exit_code == 2
    assert message in done.stderr


def test_names_select_orbits():
    assert labels(["kepler:e"]) == ["kepler"]
    assert labels(["pendulum", "pendulum:rotating"]) == ["pendulum:swinging", "pendulum:rotating"]
    assert labels() == [made.at(o.name).label for made in map(problem, PROBLEMS) for o in made.orbits]
