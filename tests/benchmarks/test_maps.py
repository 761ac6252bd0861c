"""``validate --map``: each property of a map is seen where it is, and missed where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import phasebench as pb
from support.commands import call, strict
from support.evidence import verdicts

STANDARD = """
import numpy as np
CLAIMS = {"symplectic": True, "fixed_points": [[0, 0], [np.pi, 0]]}
def map(q, p):
    p = p + 1.3 * np.sin(q)
    return q + p, p
def turn(q, p):
    return -q, p + 1.3 * np.sin(q)
"""


def standard(q, p):
    p = p + 1.3 * np.sin(q)
    return q + p, p


def leapfrog(q, p):
    """Forty steps of an anharmonic oscillator of two degrees of freedom, as a trajectory of Monte Carlo has them."""
    for _ in range(40):
        p = p - 0.05 * (q + q[::-1] ** 2 * q)
        q = q + 0.1 * p
        p = p - 0.05 * (q + q[::-1] ** 2 * q)
    return q, p


def linear(d: int, symmetric: bool):
    """The map exp(J S) of a random matrix S, which is symplectic where S is symmetric."""
    S = 0.3 * np.random.default_rng(1).normal(size=(2 * d, 2 * d))
    J = np.kron([[0, 1], [-1, 0]], np.eye(d))
    M = expm(J @ (S + S.T) if symmetric else S - np.trace(S) / (2 * d) * np.eye(2 * d))
    return lambda q, p: np.split(M @ np.concatenate([q, p]), 2)


@pytest.mark.parametrize("d", [1, 2, 5])
def test_a_map_is_symplectic_where_its_generator_is_symmetric(d):
    assert pb.validate_map(linear(d, True), symplectic=True, volume=True, d=d).verdict == "pass"
    other = verdicts(pb.validate_map(linear(d, False), symplectic=True, volume=True, d=d))
    # In one degree of freedom to keep the area is to be symplectic.
    assert (other["symplectic"], other["volume"]) == ("holds" if d == 1 else "contradicted", "holds")


@pytest.mark.parametrize("size", [1e-6, 1e-8])
def test_a_small_defect_is_seen_in_its_property_alone(size):
    def damped(q, p):
        q, p = leapfrog(q, p)
        return q, p * (1 - size)

    right = verdicts(pb.validate_map(leapfrog, symplectic=True, volume=True, reversible=True, d=2))
    wrong = verdicts(pb.validate_map(damped, symplectic=True, volume=True, reversible=True, d=2))
    assert {right[n] for n in ("symplectic", "volume", "reversible")} == {"holds"}
    assert {wrong[n] for n in ("symplectic", "volume", "reversible")} == {"contradicted"}
    assert {wrong[n] for n in ("runs", "stateless", "input")} == {"holds"}


def test_what_a_map_lacks_may_be_claimed_of_it():
    assert pb.validate_map(lambda q, p: (q * 0.9, p), symplectic=False, volume=False).verdict == "pass"
    assert pb.validate_map(standard, symplectic=False).verdict == "fail"


def test_invariants_and_fixed_points():
    def turned(q, p):
        return 0.6 * q + 0.8 * p, 0.6 * p - 0.8 * q

    claims = {"invariants": ["q**2 + p**2", "q**4 + 2*q**2*p**2 + p**4"], "fixed_points": [[0, 0]]}
    assert pb.validate_map(turned, **claims).verdict == "pass"
    assert verdicts(pb.validate_map(turned, invariants="q**2 + 1.0000001*p**2"))["invariants"] == "contradicted"
    assert verdicts(pb.validate_map(standard, fixed_points=[[0, 0], [1e-7, 0]]))["fixed_points"] == "contradicted"


def test_reversible_by_the_involution_that_is_named(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(STANDARD)
    held = {r: verdicts(pb.validate_map(file, reversible=r))["reversible"] for r in ("turn", True)}
    assert held == {"turn": "holds", True: "contradicted"}
    quarter = pb.validate_map(standard, reversible=lambda q, p: (p, -q))
    assert "involution" in quarter.claims[-1].why
    assert quarter.verdict == "fail"


def test_single_precision_is_judged_above_its_own_round_off():
    def single(q, p):
        q, p = standard(np.float32(q), np.float32(p))
        return q, p

    def leaky(q, p):
        q, p = single(q, p)
        return q, np.float32(0.98) * p

    assert pb.validate_map(single, symplectic=True).verdict != "fail"
    assert pb.validate_map(single, reversible=lambda q, p: (-q, p + np.float32(1.3) * np.sin(q))).verdict != "fail"
    assert pb.validate_map(leaky, symplectic=True).verdict == "fail"


def test_a_map_with_a_memory_or_that_changes_its_input_fails():
    calls = []
    buffer = np.zeros(1), np.zeros(1)

    def remembers(q, p):
        calls.append(1)
        return q, p + len(calls)

    def spoils(q, p):
        p += q
        return q, p

    def buffered(q, p):
        buffer[0][:], buffer[1][:] = q, p + q
        return buffer

    for f, name in ((remembers, "stateless"), (spoils, "input"), (buffered, "input")):
        found = pb.validate_map(f, symplectic=True)
        assert (found.verdict, verdicts(found)[name]) == ("fail", "contradicted")


def test_the_command(tmp_path):
    file, folder = tmp_path / "mine.py", tmp_path / "certificate"
    file.write_text(STANDARD)
    done = call("validate", "--map", file, "--claim", "reversible=turn", "--json")
    told = strict(done.stdout)
    assert (done.exit_code, told["verdict"], told["offers"]) == (0, "pass", ["volume"])
    assert call("validate", "--map", file, "--claim", "invariants=p**2", "--output", folder).exit_code == 1
    assert "FAIL" in (folder / "certificate.md").read_text()
    assert "--map" in call("validate", "--map", file, "--problem", "pendulum").said


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"symplectic": 2}, "symplectic"),
        ({"reversible": "turn"}, "turn"),
        ({"invariants": "q3**2"}, "q3"),
        ({"invariants": "__import__('os')"}, "formula"),
        ({"fixed_points": [[0, 0, 0]]}, "fixed_points"),
        ({"fixed_points": [[0, 0, 0, 0]], "d": 1}, "d = 1"),
        ({"states": [[np.nan, 0]]}, "STATES"),
        ({"d": 0}, "degrees of freedom"),
        ({"symplectik": True}, "symplectic"),
    ],
)
def test_bad_input(given, named):
    with pytest.raises(pb.InvalidInput, match=named):
        pb.validate_map(standard, **given)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("def step(q, p): return q, p", "no function 'map'"),
        ("def map(q, p): return 1 / 0", "line 1: ZeroDivisionError"),
        ("def map(q, p): return q", "must return q, p"),
        ("D = 2\ndef map(q, p): return q[:1], p[:1]", "say D"),
        ("CLAIMS = {'order': 2}\ndef map(q, p): return q, p", "order"),
    ],
)
def test_bad_files(tmp_path, text, named):
    file = tmp_path / "mine.py"
    file.write_text(text + "\n")
    with pytest.raises(pb.InvalidInput, match=named):
        pb.validate_map(file, symplectic=True)


def test_what_a_map_prints_is_no_part_of_the_result_and_what_it_raises_names_its_line(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(
        "def map(q, p):\n    print('turn')\n    return q, p\n\n\ndef other(q, p):\n    return q / None, p\n"
    )
    done = call("validate", "--map", file, "--claim", "symplectic", "--json")
    assert (done.exit_code, strict(done.stdout)["verdict"]) == (0, "pass")
    assert "turn" in done.stderr, "the control"
    with pytest.raises(pb.InvalidInput, match="line 7: TypeError"):
        pb.validate_map(f"{file}:other", symplectic=True)


def test_a_map_is_found_by_its_module(tmp_path, monkeypatch):
    (tmp_path / "rings.py").write_text(STANDARD)
    monkeypatch.chdir(tmp_path)
    found = pb.validate_map("rings:map", reversible="turn")
    assert (found.verdict, len(found.claims)) == ("pass", 6)
    for missing in ("rings:nothing", "nothing:map", "leapfrog", "./nothing.py"):
        with pytest.raises(pb.InvalidInput):
            pb.validate_map(missing)


def test_a_map_without_a_value_says_where():
    found = pb.validate_map(lambda q, p: (np.log(q), p), symplectic=True, states=[[1, 0], [-1, 0]])
    assert (found.verdict, found.claims[0].on) == ("fail", ("state 2",))
    stretched = pb.validate_map(lambda q, p: (np.exp(q), p / np.exp(q)), symplectic=True, states=[[1, 0], [2, 1]])
    assert stretched.verdict == "pass"
