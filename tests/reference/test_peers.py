"""What every peer keeps: claims, refusals, steps, rows, times, counts, statuses, prepared runs; packages not here are
left out.

What one package alone does wrong stands in the other files on peers.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import phasebench as pb
from phasebench.benchmarks.audit.claims import judgements
from phasebench.benchmarks.ladder.competitors import peers as competing
from phasebench.integrators import Hamiltonian, InvalidInput, outcome
from phasebench.reference import native
from phasebench.reference.installed import how_to_install
from phasebench.reference.peers import PEERS, integrate_peer, peer, registry, run
from phasebench.reference.peers.prepared import prepare_peer
from phasebench.reference.peers.record import NotHere
from support import peer_ends
from support.needs import need
from support.peer_ends import SPANS, exact, made
from support.planted import control
from support.solutions import end, last

DATA = Path(__file__).resolve().parents[2] / "reports" / "data"
FIXED = [p for p in PEERS if not p.adaptive]
ADAPTIVE = [p for p in PEERS if p.adaptive]
COUNTS = {"steps", "gradient", "hessian", "iterations", "fallbacks"}
RUNAWAY = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")


def by_id(peers):
    """Mark of a test that runs for each of these peers."""
    return pytest.mark.parametrize("p", peers, ids=lambda p: p.id)


# -- records ----------------------------------------------------------------------------------------------------------

LETTERS = {
    "d": "double-pendulum:regular",
    "h": "henon-heiles:box",
    "s": "perturbed-kepler",
    "k": "kepler",
    "n": "n-body",
    "p": "pendulum",
    "l": "lotka-volterra",
    "c": "charged-particle",
    "t": "toda",
    "2": "duffing",
    "r": "free-rigid-body",
}
#: Scope of a peer -> the problems that it takes.
SCOPES = {
    "any": "dhsknplct2r",
    "any Hamiltonian": "dhsknpct2r",
    "any canonical H": "dhsknpct2r",
    "any canonical H up to d = 20": "dhsknpct2r",
    "H = T(p) + V(q)": "hsknpt2",
    "H = sum p_i^2 / (2 m_i) + V(q)": "hsknpt2",
    "H = sum p_i^2 / 2 m_i + V(q)": "hsknpt2",
    "H = p.M^-1 p / 2 + V(q)": "hsknpt2",
    "H = |p|^2 / 2 + V(q), d at most 3": "hskpt2",
    "V a sum of powers of the distance, or Henon-Heiles (what galpy has in C)": "hsk2",
    "Kepler and Henon-Heiles (what gala has in C)": "hk",
    "a Kepler part with a perturbation of positions; gravity between bodies, the first in the middle": "skn",
    "a Kepler problem; gravity between bodies, the first in the middle": "kn",
    "models of bodies and joints": "dpr",
}


def test_records_are_complete():
    assert set(ENDS) == {p.id for p in FIXED if p.package != "sundials4py"}, "python tests/support/peer_ends.py"
    assert len(PEERS) == sum(len(package.PEERS) for package in registry.PACKAGES), "two records have one id"
    assert len({p.name for p in PEERS}) == len(PEERS)
    for p in PEERS:
        assert p.label == p.id
        assert p.parameters == {}
        assert p.license
        for words in (p.name, p.about, p.source, p.scope, p.claims.source):
            assert words
            assert words == words.strip(" ;,")
            assert not any(wrong in words for wrong in ("  ", "; ;", ";;", "None", "{", "}")), words


#: OpenMM states another licence than its documentation; libraries of C and C++ state none.
SILENT = ("boost", "gsl", "openmm", "sundials4py")


@pytest.mark.parametrize("package", sorted({p.package for p in PEERS} - {*SILENT}))
def test_the_license_is_that_of_the_package(package):
    need(package)
    (license,) = {p.license.split("-")[0] for p in PEERS if p.package == package}
    told = importlib.metadata.metadata(package)
    assert license in f"{told.get('License-Expression')} {told.get('License')} {told.get_all('Classifier')}"


@pytest.mark.parametrize("scope", sorted({*SCOPES, *(p.scope for p in PEERS)}))
def test_a_peer_takes_the_problems_of_its_scope_and_refuses_others(scope):
    for p in PEERS:
        why = {x: p.lacks(made(name), made(name).system) for x, name in LETTERS.items() if p.scope == scope}
        assert "".join(x for x, lack in why.items() if lack is None or isinstance(lack, NotHere)) in (SCOPES[scope], "")
        for x, lack in why.items():
            if lack is not None:
                with pytest.raises(InvalidInput, match=re.escape(lack)):
                    integrate_peer(made(LETTERS[x]), p, t_end=1.0, steps=10)


def test_claims_are_those_that_the_audit_judged():
    """Of the committed rows, which are also of packages that are not here."""
    rows = pd.read_csv(DATA / "audit_claims.csv").query("package != 'phasebench'")
    stored = {(r.peer, r.property): (r.claim, r.source) for r in rows.itertuples()}
    found = {(c["peer"], c["property"]): (c["claim"], c["source"]) for p in PEERS for c in judgements(p, "", [])}
    assert found == stored


#: The audit has no order of these, whose errors are round-off from the first step on, or is off by as much.
UNSEEN = {"desolver-rk1412", "desolver-radau-iia-19", "desolver-richardson-symplectic-euler", "rebound-eos-pmlf6"}


def test_orders_are_those_that_the_audit_measured():
    rows = pd.read_csv(DATA / "audit.csv").query("measure == 'order' and value == value")
    seen = rows.groupby("peer")["value"].agg(list)
    for p in FIXED:
        if p.id not in UNSEEN and not p.id.startswith("sundials-sofroniou"):
            assert min(abs(x - p.order) for x in seen[p.id]) < 0.15, p.id


#: Peers whose ids begin so -> (least tolerance, default where it is not the package's own).
TOLERANCES = {
    "heyoka": (2.0**-53, 2.0**-52),
    "rebound-ias15": (1e-16, None),
    "rebound-bs": (1e-14, None),
    "scipy": (100 * 2.0**-52, None),
    "gala-dopri853": (1e-14, None),
    "galpy-dop": (1e-14, None),
    "galpy-ias15-c": (0.0, None),
    "galpy-odeint": (1e-13, None),
    "desolver": (1e-14, 1e-10),
    "boost": (1e-15, 1e-6),
    "gsl": (1e-14, 1e-6),
    "openmm": (0.0, 1e-6),
}


@by_id(ADAPTIVE)
def test_the_least_tolerance_is_taken_and_none_below(p):
    (known,) = [x for start, x in TOLERANCES.items() if p.id.startswith(start)]
    assert (p.least, p.tol) == known
    name = peer_ends.problems(p)[0]
    if p.least:
        with pytest.raises(InvalidInput, match=f"none below {p.least:.3g}"):
            integrate_peer(made(name), p, t_end=0.1, tol=p.least * (1 - 1e-9))
    assert integrate_peer(made(name), p, t_end=1e-3, tol=p.least or 1e-6).status in ("ok", "skipped")


# -- refused input, missing packages ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("id", "options", "what"),
    [
        ("rebound-whfast", {"t_end": 1.0}, "step h"),
        ("rebound-whfast", {"t_end": 1.0, "h": 0.1, "tol": 1e-9}, "give h, not tol"),
        ("rebound-leapfrog", {"t_end": 1.0, "h": -0.1}, "lies ahead"),
        ("heyoka", {}, "t_end"),
        ("heyoka", {"t_end": float("nan")}, "t_end"),
        ("heyoka", {"t_end": 1.0, "steps": 0}, "steps"),
        ("rebound-ias15", {"t_end": 1.0, "tol": 0.0}, "between 0 and 1"),
        ("rebound-ias15", {"t_end": 1.0, "tol": 1.0}, "between 0 and 1"),
        ("heyoka", {"t_end": 1.0, "tol": float("nan")}, "tol"),
        ("scipy-dop853", {"t_end": 1.0, "tol": "small"}, "tol"),
        ("heyoka", {"t_end": 1.0, "save_every": -1}, "save_every"),
        ("heyoka", {"t_end": 1.0, "q0": [0.0, 0.0]}, "singularity"),
        ("heyoka", {"t_end": 1.0, "q0": [1.0]}, "components"),
        ("rebound-ias51", {"t_end": 1.0}, "rebound-ias15"),
    ],
)
def test_unusable_input_is_refused(id, options, what):
    with pytest.raises(InvalidInput, match=what):
        integrate_peer(made("kepler"), id, **options)


@pytest.mark.parametrize("package", [None, *registry.PACKAGES], ids=lambda x: x and x.__name__.split(".")[-1])
def test_a_missing_package_is_skipped(package, monkeypatch):
    """Each package's own import, and that of a made-up one."""
    p = package.PEERS[0] if package else replace(control("rk4"), package="no_such", load=importlib.import_module)
    monkeypatch.setitem(sys.modules, p.package, None)
    monkeypatch.setattr(native, "compiler", lambda language: None)
    s = integrate_peer(made(peer_ends.problems(p)[0]), p, t_end=1.0, steps=10)
    assert (s.status, s.t.tolist(), s.method) == ("skipped", [0.0], p)
    assert how_to_install(p.package) in s.reason
    json.dumps(s.counts)
    if p.prepare:
        with pytest.raises(InvalidInput, match=re.escape(how_to_install(p.package))):
            prepare_peer(made(peer_ends.problems(p)[0]), p)


# -- runs -------------------------------------------------------------------------------------------------------------

#: The stored end states; `test_packages` has answers of SUNDIALS, whose package needs a newer Python than others.
ENDS = json.loads(peer_ends.STORED.read_text())


def runs(peers):
    """Mark of a test that runs for each of these peers on each of its problems."""
    names = [(p, name) for p in peers for name in peer_ends.problems(p)]
    return pytest.mark.parametrize(("p", "name"), names, ids=[f"{p.id}-{name}" for p, name in names])


def check(s, name, steps=None):
    """Of a solution with all rows: status, times, counts, start."""
    t_end, n = SPANS[name]
    assert s.status == "ok", s.reason
    np.testing.assert_allclose(s.t, np.linspace(0, t_end, (steps or n) + 1), rtol=1e-14)
    assert (s.q[0] == made(name).q0).all()
    assert (s.p[0] == made(name).p0).all()
    assert set(s.counts) == COUNTS
    assert (s.counts["hessian"], s.counts["iterations"], s.counts["fallbacks"]) == (0, 0, 0)
    assert np.isnan(s.parameter).all()
    assert len(s.parameter) == len(s.t) - 1
    assert s.seconds > 0


def check_backwards(p, name, bound, **size):
    """From another start and time back where this project's DOP853 goes, to a tolerance at each row; or refused."""
    t_end, _ = SPANS[name]
    start = {"q0": made(name).q0, "p0": [x + 0.01 for x in made(name).p0]}
    if p.ahead:
        with pytest.raises(InvalidInput, match="ahead in time alone"):
            integrate_peer(made(name), p, t_end=-t_end, **size, **start)
        start |= {"t0": 5.0, "t_end": 5.0 + t_end}
    else:
        start |= {"t0": 5.0, "t_end": 5.0 - t_end}
    s = integrate_peer(made(name), p, save_every=int(p.adaptive), **size, **start)
    assert (s.t[0], s.t[-1]) == (5.0, start["t_end"])
    for t, q, v in zip(s.t[1:], s.q[1:], s.p[1:], strict=True):
        assert np.abs([*q, *v] - exact(name, t - 5.0, 0.01)).max() < bound


def check_prepared(p, name, size, expected, bound=0.0, **options):
    """A prepared run ends where a checked one does, again after one from another start, which ends elsewhere."""
    if p.prepare:
        prepared = prepare_peer(made(name), p, **options)
        other = np.array(made(name).q0) * (1 + 1e-3)
        for start, same in ((None, True), (None, True), (other, False), (None, True)):
            q, v, status = prepared(*size, q0=start)
            assert status == "ok"
            assert (np.abs([*q, *v] - expected).max() <= bound) == same


#: Peers that merge substeps between rows, which are not two halves of one -> what more rows change.
MERGED = {"rebound-eos": 0.1, "rebound-eos-lf4": 0.1, "rebound-mercurius": 1e-3}


@pytest.mark.lowest
@runs(FIXED)
def test_a_run_of_fixed_steps(p, name):
    need(p.package)
    t_end, n = SPANS[name]
    whole = peer_ends.run(p, name)
    check(whole, name)
    assert whole.counts["steps"] == n
    if p.package != "sundials4py":
        gradient, state = ENDS[p.id][name]
        assert whole.counts["gradient"] == gradient
        np.testing.assert_allclose(end(whole), state, rtol=1e-10, atol=1e-11)
    off = np.abs(end(whole) - exact(name, t_end)).max()
    assert off < 0.5, "or the stored end is that of another orbit"
    some, bare = (peer_ends.run(p, name, save_every=k) for k in (3, 0))
    where, same = [*range(0, n, 3), n], MERGED.get(p.id, 1e-9)
    assert [round(t * n / t_end) for t in some.t] == where
    assert np.abs(np.hstack([some.q - whole.q[where], some.p - whole.p[where]])).max() < same
    assert np.abs(end(bare) - end(whole)).max() < same
    if p.id != "rebound-trace":  # where h < 0 it stands still in an encounter and at a pericentre (REBOUND 5.2.2)
        check_backwards(p, name, 10 * off + 1e-9, h=t_end / n * (1 if p.ahead else -1))
    check_prepared(p, name, (t_end / n, n), end(bare))


#: Peers that ignore their tolerance, or start with what the run before found.
DEAF, REMEMBERS = ("galpy-ias15-c",), ("rebound-ias15", "rebound-bs")
TIGHT, LOOSE = 1e-9, 1e-4


@pytest.mark.lowest
@runs(ADAPTIVE)
def test_a_run_to_a_tolerance(p, name):
    need(p.package)
    t_end, _ = SPANS[name]
    tight, loose = (integrate_peer(made(name), p, t_end=t_end, steps=4, tol=tol) for tol in (TIGHT, LOOSE))
    check(tight, name, 4)
    errors = [
        max(np.abs([*q, *v] - exact(name, t)).max() for t, q, v in zip(s.t[1:], s.q[1:], s.p[1:], strict=True))
        for s in (tight, loose)
    ]
    assert errors[0] < 1e-6
    assert errors[1] < 1e-2
    assert errors[0] < errors[1] / 10 or errors[1] < 1e-8 or p.id in DEAF
    steps, fewer = tight.counts["steps"], loose.counts["steps"]
    assert steps >= fewer > 0 or not steps
    assert tight.counts["gradient"] > steps or not tight.counts["gradient"]
    check_backwards(p, name, 1e-6, tol=TIGHT, steps=4)
    bare = last(integrate_peer(made(name), p, t_end=t_end, tol=TIGHT))
    check_prepared(p, name, (t_end,), bare, 1e3 * TIGHT if p.id in REMEMBERS else 0.0, tol=TIGHT)
    if steps:
        few, many = (integrate_peer(made(name), p, t_end=t_end, tol=LOOSE, steps=k).counts["steps"] for k in (1, 500))
        assert (many >= 499) == p.rows_end_steps == (many != few)


@by_id(PEERS)
def test_a_blow_up_keeps_finite_rows(p):
    need(p.package)
    if p.lacks(RUNAWAY, RUNAWAY) or p.id == "openmm-variable-verlet-adaptive":
        pytest.skip("not its kind of system, or its steps shrink without end")
    s = integrate_peer(RUNAWAY, p, t_end=20.0, steps=40, tol=1e-6 if p.adaptive else None, q0=[1.0], p0=[1.0])
    assert s.status == "diverged"
    assert s.reason
    assert 1 <= len(s.t) < 41
    assert np.isfinite([s.q, s.p]).all()


# -- statuses ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [("q", 2, 0), ("p", 2, 1)])
def test_a_single_nan_ends_the_rows(where):
    name, row, component = where
    rows = {"q": np.ones((4, 2)), "p": np.ones((4, 2))}
    rows[name][row, component] = np.nan
    times = np.array([0.0, 0.5, 1.0, 7.0])
    for failure, why in (("it says why.", "it says why; "), (None, "")):
        status, reason, good = run.ending(made("henon-heiles:box").system, times, rows["q"], rows["p"], failure)
        assert (status, good) == ("diverged", 2)
        assert reason.startswith(why)
        assert reason.endswith("the rows end at t = 0.5 of 7")


@pytest.mark.parametrize(
    ("energies", "status", "rows"),
    [
        ((1.0, -9.0, 1.0), "judged", 3),  # exactly ten times its size
        ((1.0, 11.5, 1.0), "collision", 3),
        ((1.0, -9.5, 1.0), "collision", 3),
        ((1.0, np.nan, 1.0), "diverged", 1),
        ((1.0, 1.0, np.inf), "diverged", 2),
    ],
)
def test_energy_errors_mean_collision_or_divergence(energies, status, rows, monkeypatch):
    monkeypatch.setattr(outcome, "energy_unit", lambda *_: 1.0)
    monkeypatch.setattr(outcome, "judge", lambda *_: ("judged", ""))
    times, states = np.array([0.0, 1.0, 2.0]), np.zeros((3, 1))
    for singular in (True, False):
        system = SimpleNamespace(H=energies, singular=singular, observe=lambda H, q, p: np.asarray(H))
        found, _, good = run.ending(system, times, states, states, None)
        assert (found, good) == ("judged" if status == "collision" and not singular else status, rows)


def test_a_fall_into_the_singularity_has_a_status():
    for id in ("heyoka", "rebound-ias15", "rebound-leapfrog", "scipy-dop853"):
        size = {"t_end": 2.0, "steps": None if peer(id).adaptive else 100}
        s = integrate_peer(made("kepler"), id, **size, q0=[1, 0], p0=[0, 0])
        assert s.status in ("diverged", "collision")


# -- prepared peers as pb.prepare makes them ---------------------------------------------------------------------------


def test_every_competing_peer_can_be_prepared():
    assert [p.id for p in competing() if p.prepare is None] == []


def test_a_returned_state_is_not_overwritten():
    for id, size in (("heyoka", (1.0,)), ("rebound-whfast", (0.1, 10)), ("scipy-dop853-numba", (1.0,))):
        run = pb.prepare("kepler", id)
        q, p, _ = run(*size)
        before = q.copy(), p.copy()
        run(*size, q0=[0.5, 0.1])
        assert (q == before[0]).all()
        assert (p == before[1]).all()


def test_a_failed_run_has_another_status():
    for id in ("heyoka", "scipy-dop853-numba"):
        run = pb.prepare(RUNAWAY, id, tol=1e-9, q0=[1.0], p0=[1.0])
        assert run(0.5)[2] == run.SOLVED
        assert run(5.0)[2] == run.STALLED == "not-converged"


@pytest.mark.parametrize(
    ("method", "options", "said"),
    [
        ("heyoka", {"tol": 2.0}, "tol is 2.0"),
        ("heyoka", {"parameters": {"lam": 1}}, "no parameters such as lam"),
        ("rebound-whfast", {"tol": 1e-9}, "steps of fixed size"),
        ("stormer-verlet", {"tol": 1e-9}, "takes a step h, no tolerance"),
        ("heyoka-batch", {}, "no prepared run"),
        (lambda system, q, p, h: (q, p), {}, "no prepared run"),
        ("heyok", {}, "did you mean"),
    ],
)
def test_invalid_preparations_are_refused(method, options, said):
    with pytest.raises(pb.InvalidInput, match=said):
        pb.prepare("kepler", method, **options)
