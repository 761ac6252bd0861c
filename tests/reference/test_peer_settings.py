"""The settings with which REBOUND's integrators really run, as REBOUND reports them.

The table follows REBOUND's documentation and the names of the peers; fields it does not name must have REBOUND's
defaults, except for the tolerance.
"""

from __future__ import annotations

import pytest

from phasebench.benchmarks.problems import problem
from phasebench.reference.peers import BY_ID, PEERS, integrate_peer, particles
from phasebench.reference.peers import rebound as peers

rebound = pytest.importorskip("rebound")

FAST = {"safe_mode": 0}
#: Peer -> (integrator, fields that differ from REBOUND's defaults).
SETTINGS = {
    "ias15": ("ias15", {"min_dt": 1e-13}),
    "bs": ("bs", {}),
    "whfast": ("whfast", FAST | {"corrector": 17, "kernel": "LAZY"}),
    "whfast-plain": ("whfast", FAST),
    **{f"whfast-corrector-{n}": ("whfast", FAST | {"corrector": n}) for n in (3, 5, 7, 11, 17)},
    "whfast-modifiedkick": ("whfast", FAST | {"corrector": 17, "kernel": "MODIFIEDKICK"}),
    "whfast-composition": ("whfast", FAST | {"corrector": 17, "kernel": "COMPOSITION"}),
    "whfast512": ("whfast512", {}),
    "whfast512-corrector-17": ("whfast512", {"corrector": 17}),
    **{
        f"saba-{name.lower().replace('_', '-')}": ("saba", FAST | {"type": name})
        for name in (
            *("1", "2", "3", "4", "CM_1", "CM_2", "CM_3", "CM_4", "CL_1", "CL_2", "CL_3", "CL_4"),
            *("10_4", "8_6_4", "10_6_4", "H_8_4_4", "H_8_6_4", "H_10_6_4"),
        )
    },
    "leapfrog": ("leapfrog", {"order": 2}),
    **{f"leapfrog-{n}": ("leapfrog", {"order": n}) for n in (4, 6, 8)},
    **{f"janus-{n}": ("janus", {"order": n, "scale_pos": 1e-16, "scale_vel": 1e-16}) for n in (2, 4, 6, 8, 10)},
    "eos": ("eos", FAST | {"n": 2, "phi0": "LF", "phi1": "LF"}),
    "eos-lf4": ("eos", FAST | {"n": 2, "phi0": "LF4", "phi1": "LF4"}),
    "eos-lf8": ("eos", FAST | {"n": 2, "phi0": "LF8", "phi1": "LF8"}),
    "eos-pmlf6": ("eos", FAST | {"n": 2, "phi0": "PMLF6", "phi1": "LF8"}),
    "mercurius": ("mercurius", FAST),
    "trace": ("trace", {}),
}
#: Fields that a run sets itself, and fields that hold the tolerance.
ITS_OWN = {"whfast512": ("concatenate_steps",), "ias15": ("epsilon",), "bs": ("eps_abs", "eps_rel")}
#: Internal state, which is not a setting.
STATE = ("first_or_last_step",)
#: Names that REBOUND gives to the number 0 (the first type of SABA has two).
ALIAS = {"DEFAULT": "0", "1": "0"}
#: Types of the settings that can be read.
READ = (int, float, str)


def fields(integrator) -> dict:
    """{name: value} of an integrator's settings as REBOUND returns them, names in place of numbers."""
    found = {}
    for attribute in integrator.__doc__.split("----------\n", 1)[1].splitlines() if integrator.__doc__ else ():
        name, colon, _ = attribute.partition(" : ")
        if colon and name.isidentifier():
            try:
                value = getattr(integrator, name)
            except TypeError:  # a C function that is not set
                continue
            if isinstance(value, READ) and name not in STATE:
                found[name] = ALIAS.get(value, value.upper()) if isinstance(value, str) else value
    return found


def default(name: str) -> dict:
    """REBOUND's default settings of an integrator."""
    sim = rebound.Simulation()
    sim.integrator = name
    return fields(sim.integrator)


def test_the_table_names_every_peer():
    assert {f"rebound-{name}" for name in SETTINGS} == {p.id for p in PEERS if p.package == "rebound"}


@pytest.fixture
def ran(monkeypatch):
    """List of (simulation, force) of the runs made."""
    kept, build = [], particles.build
    monkeypatch.setattr(particles, "build", lambda *a, **k: (kept.append(build(*a, **k)), kept[-1])[1])
    return kept


@pytest.mark.parametrize("name", SETTINGS)
def test_the_settings_of_a_peer(name, ran):
    integrator, wanted = SETTINGS[name]
    made, peer = problem("outer-solar-system"), BY_ID[f"rebound-{name}"]
    if peer.lacks(made, made.system):
        pytest.skip(peer.lacks(made, made.system))
    size = {"t_end": 100.0, "tol": 1e-7} if peer.adaptive else {"h": 50.0, "steps": 2}
    assert integrate_peer(made, peer, **size).status == "ok"
    ((sim, _),) = ran
    assert sim.integrator.name == integrator.encode()
    found, usual = fields(sim.integrator), default(integrator)
    wanted = {k: ALIAS.get(x, x) for k, x in wanted.items()}
    if "min_dt" in wanted:
        wanted = wanted | {"min_dt": pytest.approx(wanted["min_dt"] * 100)}
    own = ITS_OWN.get(integrator, ())
    assert {k: v for k, v in found.items() if k not in own} == {
        k: v for k, v in (usual | wanted).items() if k not in own
    }
    assert set(wanted) <= set(found), "a field that cannot be read back"
    if peer.adaptive:
        assert all(found[k] == 1e-7 for k in own)
    elif integrator == "whfast512":
        assert found["concatenate_steps"] == 1


@pytest.mark.parametrize("mode", peers.ADAPTIVE_MODES)
def test_the_adaptive_modes_of_ias15(mode, ran):
    made = problem("perturbed-kepler", e=0.2)
    peer = peers.ias15(mode)
    assert (peer.id == "rebound-ias15") == (mode == "prs23")
    assert integrate_peer(made, peer, t_end=10.0, tol=1e-9).status == "ok"
    ((sim, _),) = ran
    assert fields(sim.integrator)["adaptive_mode"] == mode.upper()
    assert default("ias15")["adaptive_mode"] == "PRS23"
