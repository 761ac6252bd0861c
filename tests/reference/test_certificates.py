"""The certified references: stored for every problem, true in 25 digits of the energy, and bound to their problem."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from rich.console import Console

from phasebench.benchmarks.experiments.references import certify
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.certificates import make as certification
from phasebench.reference.certificates import stored as certified
from phasebench.reference.solvers import gauss as gauss_check
from phasebench.reference.solvers import taylor
from phasebench.reference.solvers.exact import exact

UNSTABLE = ("henon-heiles:chaotic", "quadrupole-boson:h20", "double-pendulum:chaotic", "fpu", "n-body")
REGULAR = ("harmonic-oscillator", "kepler", "henon-heiles:box", "double-pendulum:regular")
#: States of more numbers are checked at their last time alone.
MANY = 20


def spoilt(text: str, digit: int = 20) -> str:
    """A decimal string with another digit at that place after the point."""
    at = text.index(".") + digit
    return f"{text[:at]}{(int(text[at]) + 5) % 10}{text[at + 1 :]}"


def largest(made, state) -> int:
    """The component, of (q, p), whose change moves the energy most."""
    z = (*state.q_text, *state.p_text)
    with mpmath.workdps(50):
        slopes = certified.evaluate(made, [made.system.H.diff(x) for x in (*made.system.q, *made.system.p)], *halves(z))
    return int(np.argmax([abs(float(s) * float(x)) for s, x in zip(slopes, z, strict=True)]))


def halves(z):
    return z[: len(z) // 2], z[len(z) // 2 :]


# -- what is stored ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("label", certify.labels())
def test_every_orbit_has_a_reference_that_holds(label):
    """Where this fails for a new problem: choose its times in benchmarks/certify.py, then the command it names."""
    assert label in certify.TIMES, f"{label} has no times in benchmarks/certify.py; add them"
    made = problem(label)
    ends = certified.load(made)
    assert tuple(e.t for e in ends) == certify.TIMES[label], f"phasebench certify {label} --update"
    found = certified.find(made)
    assert found.digits_horizon == found.t_end, "the stored digits do not hold to the end"
    for state in ends if made.system.d < MANY else ends[-1:]:
        assert state.agree, state.checks
        assert state.uncertainty < 1e-3 * state.long_double
        assert abs(certified.energy_change(made, state.q_text, state.p_text)) < 1e-25


@pytest.mark.parametrize("label", ["kepler", "henon-heiles:chaotic", "lotka-volterra:4-2", "outer-solar-system"])
def test_control_the_energy_sees_one_digit(label):
    made = problem(label)
    state = certified.load(made)[-1]
    z = [*state.q_text, *state.p_text]
    i = largest(made, state)
    z[i] = spoilt(z[i])
    assert abs(certified.energy_change(made, *halves(z))) > 1e-25


@pytest.mark.parametrize("label", ["harmonic-oscillator", "kepler"])
def test_the_digits_are_those_of_the_exact_solution(label):
    made = problem(label)
    ends = certified.load(made)
    with mpmath.workdps(50):
        Q, P = exact(made, [e.t for e in ends], 45)
        for state, q, p in zip(ends, Q, P, strict=True):
            pairs = zip((*state.q_text, *state.p_text), (*q, *p), strict=True)
            error = max(abs(mpmath.mpf(x) - y) for x, y in pairs)
            assert error < 4 * state.uncertainty
            assert error < 1e-25


@pytest.mark.parametrize("label", ["pendulum:rotating", "kepler", "lotka-volterra:4-2", "duffing:both-wells"])
def test_a_double_run_meets_the_stored_states(label):
    made = problem(label)
    early = [e for e in certified.load(made) if e.t <= 10]
    rows = taylor.states(made.system, float, made.q0, made.p0, [e.t for e in early])
    for row, state in zip(rows, early, strict=True):
        z = np.concatenate([state.q, state.p])
        assert np.abs(row - z).max() < 1e-12
        assert np.abs(row - z * (1 + 1e-10)).max() > 1e-12


@pytest.mark.parametrize("label", UNSTABLE)
def test_an_unstable_orbit_is_not_trusted_to_its_end(label):
    found = certified.find(problem(label))
    assert 0 < found.horizon < found.t_end
    assert found.rate > 0


@pytest.mark.parametrize("label", REGULAR)
def test_a_regular_orbit_is_trusted_to_its_end(label):
    found = certified.find(problem(label))
    assert (found.horizon, found.rate) == (found.t_end, None)


# -- looked up --------------------------------------------------------------------------------------------------------


def test_a_state_is_found_at_its_time_and_parameters_alone():
    made = problem("kepler")
    state = certified.end(made, 1.0)
    assert state.t == 1.0
    assert abs(state.q @ state.q - float(sum(float(x) ** 2 for x in state.q_text))) < 1e-15
    assert certified.end(made, np.nextafter(1.0, 2.0)) is None
    other = problem("kepler", e=0.5)
    assert certified.end(other, 1.0) is None
    with pytest.raises(InvalidInput, match=r"no reference of kepler at e = 0\.5"):
        certified.load(other)
    with pytest.raises(InvalidInput, match="certify kepler --update"):
        certified.load(made, "nowhere")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The kepler file in a folder of its own, which the commands use."""
    original = certified.DIRECTORY / "kepler.json"
    (tmp_path / "kepler.json").write_text(original.read_text())
    monkeypatch.setattr(certified, "DIRECTORY", tmp_path)
    return tmp_path


def resealed(path, change) -> None:
    """Change the content of a file and give it the right checksum."""
    content = json.loads(path.read_text())
    content.pop("sha256")
    change(content)
    path.write_text(json.dumps(content | {"sha256": certified._digest(content)}))


def without_time(content):
    del content["references"][0]["ends"][0]["t"]


def with_word(content):
    content["references"][0]["ends"][0]["q_text"][0] = "half"


def with_too_few(content):
    content["references"][0]["ends"][0]["q_text"].pop()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: path.write_text(path.read_text()[:-500]), "no JSON"),
        (lambda path: path.write_bytes(b"\xff\xfe"), "no JSON"),
        (lambda path: path.write_text("[]"), "no file of format"),
        (lambda path: path.write_text(path.read_text().replace('"uncertainty": ', '"uncertainty": 1', 1)), "checksum"),
        (lambda path: resealed(path, lambda c: c.update(problem="pendulum")), "of the problem 'pendulum'"),
        (lambda path: resealed(path, without_time), "cannot be read"),
        (lambda path: resealed(path, with_word), "cannot be read"),
        (lambda path: resealed(path, with_too_few), "cannot be read"),
    ],
)
def test_a_damaged_file_is_refused(folder, damage, message):
    path = folder / "kepler.json"
    damage(path)
    with pytest.raises(InvalidInput, match=message) as caught:
        certified.end(problem("kepler"), 1.0)
    assert str(path) in str(caught.value)
    assert "phasebench certify kepler --update" in str(caught.value)


def test_a_problem_that_changed_is_refused():
    made = problem("kepler")
    orbit = made.start
    with pytest.raises(InvalidInput, match="initial data of kepler are no longer"):
        certified.load(replace(made, orbits=(replace(orbit, q=(np.nextafter(orbit.q[0], 1), 0.0)),)))
    s = made.system
    mass = Hamiltonian(q=s.q, p=s.p, H=s.H + s.p[0] ** 2 / 1000)
    with pytest.raises(InvalidInput, match="formulae of kepler are no longer"):
        certified.load(replace(made, system=mass))
    same = Hamiltonian(q=s.q, p=s.p, H=s.H.expand())
    assert certified.load(replace(made, system=same)) == certified.load(made)


# -- computed anew ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def short():
    """A fresh certificate of the pendulum to t = 10."""
    return certification.certify(problem("pendulum:swinging"), [1.0, 10.0], grid_points=20)


def test_a_fresh_run_meets_what_is_stored(short):
    for new in short.ends:
        distance, allowed = certification.moved(certified.end(problem("pendulum:swinging"), new.t), new)
        assert distance <= allowed < 1e-30
        assert new.agree


def test_a_moved_digit_is_seen(short):
    """The last digit of quadruple precision is noise, one three places before it is not."""
    assert certify.compare(short, short).changed == ""
    for digit, says in ((33, ""), (30, "moved at t = 10")):
        last = replace(short.ends[-1], q_text=(spoilt(short.ends[-1].q_text[0], digit),))
        assert certify.compare(replace(short, ends=(short.ends[0], last)), short).changed == says
    assert certify.compare(None, short).changed == "not stored"
    assert certify.compare(replace(short, ends=short.ends[1:]), short).changed == "stored at other times"


def test_control_a_second_solver_of_another_equation_disagrees(monkeypatch):
    """g/l = 1 + 1e-15: an error that only the second solver's long double can see."""
    right = gauss_check.right_hand_side

    def slightly_wrong(system):
        F = right(system)
        return lambda Y: F(Y) * np.array([[1], [1 + 1e-15]])

    monkeypatch.setattr(gauss_check, "right_hand_side", slightly_wrong)
    found = certification.certify(problem("pendulum:swinging"), [10.0], grid_points=20)
    assert not found.ends[0].agree


@pytest.mark.parametrize("label", ["kepler", "quadrupole-boson:benchmark", "lotka-volterra-log:4-8"])
def test_gauss_is_exact_to_long_double(label):
    """Constants such as 2**(1/2) and 1/3 are not to be doubles: the error would be 1e-16."""
    made = problem(label)
    long, quad = taylor.extended()
    ends = taylor.step_ends(made.system, long, made.q0, made.p0, 2.0)
    found = gauss_check.run(made.system, made.q0, made.p0, [x / 2 for x in ends] + ends, [2.0])[0]
    truth = taylor.states(made.system, quad, made.q0, made.p0, [2.0])[0]
    assert max(abs(float(quad(a) - b)) for a, b in zip(found, truth, strict=True)) < 3e-18 * max(map(abs, found))


def test_gauss_says_where_its_stages_have_no_solution():
    made = problem("harmonic-oscillator")
    with pytest.raises(taylor.ReferenceFailed, match="no solution after t = 0"):
        gauss_check.run(made.system, made.q0, made.p0, [], [50.0])


@pytest.mark.parametrize("times", [[], [0.0, 1.0], [2.0, 1.0], [float("nan")]])
def test_bad_times_are_refused(times):
    with pytest.raises(InvalidInput, match="positive, finite and increase"):
        certification.certify(problem("kepler"), times)


# -- the command ------------------------------------------------------------------------------------------------------


def run(*names, **options):
    """(exit code, what was printed)."""
    out = Console(file=io.StringIO(), width=200)
    return certify.certify(names, console=out, progress=Console(file=io.StringIO()), **options), out.file.getvalue()


def test_the_command_says_that_nothing_moved_and_what_did():
    known = certified.find(problem("kepler"))
    code, text = run("kepler", make=lambda label: certify.compare(known, known))
    assert code == 0
    assert "nothing moved" in text
    first = replace(known.ends[0], p_text=(spoilt(known.ends[0].p_text[0], 15), known.ends[0].p_text[1]))
    other = replace(known, ends=(first, *known.ends[1:]))
    code, text = run("kepler", make=lambda label: certify.compare(known, other))
    assert code == 1
    assert "moved at t = 1" in text
    wrong = replace(known.ends[0], checks=(replace(known.ends[0].checks[0], distance=1.0),))
    other = replace(known, ends=(wrong, *known.ends[1:]))
    code, text = run("kepler", make=lambda label: certify.compare(known, other))
    assert code == 1
    assert "disagree" in text


def test_an_update_keeps_each_problem_at_once(folder):
    """The second problem is never reached; the first is stored, over a file that could not be read."""
    known = certified.find(problem("kepler"))
    (folder / "kepler.json").write_text("{")

    def make(label):
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certification, "certify", lambda made, times: known)
        with pytest.raises(KeyboardInterrupt):
            run("kepler", "fpu", update=True, make=make)
    assert certified.find(problem("kepler")) == known
    assert [p.name for p in folder.iterdir()] == ["kepler.json"]


def test_one_time_is_certified_and_printed():
    code, text = run("pendulum:swinging", t_end=1.0)
    assert code == 0
    assert certified.end(problem("pendulum:swinging"), 1.0).q_text[0][:28] in text
    assert "agrees" in text


@pytest.mark.parametrize(
    ("names", "options", "message"),
    [
        (["keplar"], {}, "did you mean kepler"),
        (["henon-heiles:boxes"], {}, "did you mean box"),
        (["pendulum", "kepler"], {"t_end": 1.0}, "one problem"),
        (["kepler"], {"t_end": -1.0}, "must be a positive number"),
        (["kepler"], {"t_end": float("nan")}, "must be a positive number"),
    ],
)
def test_bad_input_of_the_command(names, options, message):
    with pytest.raises(InvalidInput, match=message):
        run(*names, **options)


def test_names_stand_for_orbits():
    assert certify.chosen(["kepler:e"]) == ["kepler"]
    assert certify.chosen(["pendulum"]) == ["pendulum:swinging", "pendulum:rotating"]
    assert certify.chosen([]) == certify.labels()
