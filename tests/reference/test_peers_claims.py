"""Claims and options of the peers whose packages cannot be queried for them.

They are written down a second time here, as read in the documentation of the versions of 2026. Claims of desolver,
pyhamsys and diffrax are compared with the packages in `test_peers_packages`, SUNDIALS's in `test_peers_sundials`.
"""

from __future__ import annotations

import re

import pytest

from phasebench.reference.peers import PEERS, rebound

#: id, order, symplectic, reversible, energy, options of the integrator; "-" means that nothing is claimed.
SAID = """
heyoka                        - -   -   round-off
heyoka-high-accuracy          - -   -   round-off
heyoka-batch                  - -   -   round-off
rebound-ias15                15 no  -   round-off
rebound-bs                    - no  -   drift
rebound-whfast                - yes -   -         safe_mode=0 corrector=17 kernel=lazy
rebound-whfast-plain          2 yes -   -         safe_mode=0
rebound-whfast-corrector-3    2 yes -   -         safe_mode=0 corrector=3
rebound-whfast-corrector-5    2 yes -   -         safe_mode=0 corrector=5
rebound-whfast-corrector-7    2 yes -   -         safe_mode=0 corrector=7
rebound-whfast-corrector-11   2 yes -   -         safe_mode=0 corrector=11
rebound-whfast-corrector-17   2 yes -   -         safe_mode=0 corrector=17
rebound-whfast-modifiedkick   - yes -   -         safe_mode=0 corrector=17 kernel=modifiedkick
rebound-whfast-composition    - yes -   -         safe_mode=0 corrector=17 kernel=composition
rebound-whfast512             - yes -   -
rebound-whfast512-corrector-17 - yes -  -         corrector=17
rebound-saba-1                - yes -   -         safe_mode=0 type=1
rebound-saba-2                - yes -   -         safe_mode=0 type=2
rebound-saba-3                - yes -   -         safe_mode=0 type=3
rebound-saba-4                - yes -   -         safe_mode=0 type=4
rebound-saba-cm-1             - yes -   -         safe_mode=0 type=CM_1
rebound-saba-cm-2             - yes -   -         safe_mode=0 type=CM_2
rebound-saba-cm-3             - yes -   -         safe_mode=0 type=CM_3
rebound-saba-cm-4             - yes -   -         safe_mode=0 type=CM_4
rebound-saba-cl-1             - yes -   -         safe_mode=0 type=CL_1
rebound-saba-cl-2             - yes -   -         safe_mode=0 type=CL_2
rebound-saba-cl-3             - yes -   -         safe_mode=0 type=CL_3
rebound-saba-cl-4             - yes -   -         safe_mode=0 type=CL_4
rebound-saba-10-4             4 yes -   -         safe_mode=0 type=10_4
rebound-saba-8-6-4            4 yes -   -         safe_mode=0 type=8_6_4
rebound-saba-10-6-4           4 yes -   -         safe_mode=0 type=10_6_4
rebound-saba-h-8-4-4          4 yes -   -         safe_mode=0 type=H_8_4_4
rebound-saba-h-8-6-4          4 yes -   -         safe_mode=0 type=H_8_6_4
rebound-saba-h-10-6-4         4 yes -   -         safe_mode=0 type=H_10_6_4
rebound-leapfrog              2 yes -   -         order=2
rebound-leapfrog-4            4 yes -   -         order=4
rebound-leapfrog-6            6 yes -   -         order=6
rebound-leapfrog-8            8 yes -   -         order=8
rebound-janus-2               2 yes yes -         order=2
rebound-janus-4               4 yes yes -         order=4
rebound-janus-6               6 yes yes -         order=6
rebound-janus-8               8 yes yes -         order=8
rebound-janus-10             10 yes yes -         order=10
rebound-eos                   2 -   -   -         safe_mode=0 n=2 phi0=LF phi1=LF
rebound-eos-lf4               4 -   -   -         safe_mode=0 n=2 phi0=LF4 phi1=LF4
rebound-eos-lf8               8 -   -   -         safe_mode=0 n=2 phi0=LF8 phi1=LF8
rebound-eos-pmlf6             6 -   -   -         safe_mode=0 n=2 phi0=PMLF6 phi1=LF8
rebound-mercurius             - yes -   -         safe_mode=0
rebound-trace                 - -   -   -
scipy-dop853                  8 -   -   -
scipy-dop853-numba            8 -   -   -
scipy-radau                   5 -   -   -
scipy-radau-numba             5 -   -   -
scipy-lsoda                   - -   -   -
scipy-lsoda-numba             - -   -   -
gala-leapfrog                 2 yes yes bounded
gala-ruth4                    4 yes yes -
gala-rk5                      5 no  -   drift
gala-dopri853                 5 -   -   -
gala-leapfrog-cython          2 yes yes bounded
gala-ruth4-cython             4 yes yes -
gala-dopri853-cython          5 -   -   -
galpy-leapfrog                - yes -   -
galpy-leapfrog-c              - yes -   -
galpy-symplec4-c              4 yes -   -
galpy-symplec6-c              6 yes -   -
galpy-rk4-c                   4 -   -   -
galpy-rk6-c                   6 -   -   -
galpy-dopr54-c                5 -   -   -
galpy-dop853                  8 -   -   -
galpy-dop853-c                8 -   -   -
galpy-ias15-c                15 -   -   -
galpy-odeint                  - -   -   -
"""
WORDS = {"-": None, "yes": True, "no": False}
LINES = {line.split()[0]: line.split()[1:] for line in SAID.strip().splitlines()}
OTHERS = (
    "desolver",
    "pyhamsys",
    "diffrax",
    "sundials4py",
    "boost",
    "gsl",
    "pynamicalsys",
    "blackjax",
    "openmm",
    "ase",
    "jax_md",
    "mujoco",
)
MINE = [p for p in PEERS if p.package not in OTHERS]


def test_every_peer_of_these_packages_has_its_line():
    assert [p.id for p in MINE] == list(LINES)


@pytest.mark.parametrize("peer", MINE, ids=lambda p: p.id)
def test_claims_and_options_equal_the_table(peer):
    order, symplectic, reversible, energy, *options = LINES[peer.id]
    said = peer.claims
    assert said.order == (None if order == "-" else int(order))
    assert (said.symplectic, said.reversible) == (WORDS[symplectic], WORDS[reversible])
    assert said.energy == (None if energy == "-" else energy)
    assert said.source
    ours = {k: str(v) for k, v in peer.settings.items() if k not in ("integrator", "scale_pos", "scale_vel")}
    assert ours == dict(o.split("=") for o in options)
    assert set(peer.settings) <= {"integrator", *ours, "scale_pos", "scale_vel"}


def test_options_in_records_are_passed_to_rebound(monkeypatch):
    """What a record says is set is what REBOUND is given."""
    given = {}

    def run(task, setting, integrator, options, **how):
        given.update(integrator=integrator, options=dict(options))
        raise InterruptedError

    monkeypatch.setattr(rebound.particles, "run", run)
    from phasebench.benchmarks.problems import problem
    from phasebench.reference.peers import integrate_peer

    made = problem("outer-solar-system")
    for peer in rebound.PEERS:
        if peer.lacks(made, made.system):
            continue
        with pytest.raises(InterruptedError):
            integrate_peer(made, peer, h=100.0, steps=2)
        assert given["integrator"] == peer.settings["integrator"]
        set_here = {k: v for k, v in peer.settings.items() if k != "integrator"}
        assert {k: v for k, v in given["options"].items() if k != "min_dt"} == set_here


def test_rebounds_documentation_states_the_claims():
    package = pytest.importorskip("rebound")
    sim = package.Simulation()

    def words(name):
        sim.integrator = name
        return " ".join(sim.integrator.__doc__.split())

    assert "15th order" in words("ias15")
    assert "very high order, non-symplectic" in words("ias15")
    assert "BS is not a symplectic integrator" in words("bs")
    assert "symplectic [Wisdom & Holman (1991)] integrator" in words("whfast")
    assert "It is symplectic. By default it is second order" in words("leapfrog")
    assert "bit-wise time-reversible high-order symplectic integrator" in words("janus")
    assert "Supported values: 2, 4, 6, 8, 10." in words("janus")
    assert re.search(r"SABA\(8,6,4\),? ?SABA\(10,6,4\)", words("saba"))
    assert "hybrid symplectic integrator" in words("mercurius")
    assert "(almost) time-reversible" in words("trace")
    assert "symplectic" not in words("eos").lower()


def test_galas_documentation_states_the_claims():
    package = pytest.importorskip("gala.integrate")
    leapfrog = " ".join(package.LeapfrogIntegrator.__doc__.split())
    for words in ("second-order symplectic", "* Time-reversible", "bounded energy errors"):
        assert words in leapfrog
    ruth = " ".join(package.Ruth4Integrator.__doc__.split())
    for words in ("fourth-order symplectic", "time-reversibility"):
        assert words in ruth
    assert "* Fifth-order accuracy" in package.RK5Integrator.__doc__
    assert "Not symplectic" in package.RK5Integrator.__doc__
    assert "5th-order" in package.DOPRI853Integrator.__doc__


def test_galpys_documentation_states_the_claims():
    from phasebench.reference.peers import galpy

    pytest.importorskip("galpy")
    text = galpy.load().orbit.Orbit.integrate.__doc__
    numbers = {"symplec4_c": "4th order symplectic", "symplec6_c": "6th order symplectic", "rk4_c": "4th-order"}
    numbers |= {
        "rk6_c": "6-th order",
        "dopr54_c": "5-4",
        "dop853": "8-5-3",
        "dop853_c": "8-5-3",
        "ias15_c": "15th order",
    }
    for name, words in numbers.items():
        line = next(line for line in text.splitlines() if f"'{name}' for" in line)
        assert words in line
        claimed = next(p for p in galpy.PEERS if p.id == f"galpy-{name.replace('_', '-')}").claims
        assert claimed.order == int(re.match(r"\d+", words).group())
        assert bool(claimed.symplectic) is ("symplectic" in words)


def test_scipys_documentation_states_the_claims():
    import scipy.integrate

    assert "order 8" in scipy.integrate.DOP853.__doc__.splitlines()[0]
    assert "Radau IIA family of order 5" in scipy.integrate.Radau.__doc__.splitlines()[0]
