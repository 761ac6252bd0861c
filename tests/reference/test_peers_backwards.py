"""Peers integrate backwards in time, from any initial time."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, integrate
from phasebench.reference.native import LIBRARIES
from phasebench.reference.peers import PEERS, integrate_peer
from support.needs import need


@pytest.mark.parametrize("peer", PEERS, ids=lambda p: p.id)
def test_a_peer_integrates_backwards(peer):
    if peer.package in LIBRARIES:
        pytest.skip("test_peers_native tries it")
    need(peer.package)
    made = next(
        (p for p in map(problem, ("pendulum", "kepler", "henon-heiles:box")) if not peer.lacks(p, p.system)), None
    )
    if made is None:
        pytest.skip("none of the problems is one of its kind")
    size = {} if peer.adaptive else {"h": 0.01}
    start = {"q0": made.q0, "p0": [x + 0.1 for x in made.p0]}
    if peer.ahead:
        with pytest.raises(InvalidInput, match="ahead in time alone"):
            integrate_peer(made, peer, t_end=-1.0, **size, **start)
        return
    s = integrate_peer(made, peer, t_end=-1.0, **size, **start)
    exact, ahead = (integrate(made, "gauss-8", h=0.01, t_end=t_end, **start) for t_end in (-1.0, 1.0))
    off = np.abs(s.q[-1] - exact.q[-1]).max()
    assert (s.status, s.t[-1]) == ("ok", -1.0)
    assert off < 2e-2 < 0.1 < np.abs(s.q[-1] - ahead.q[-1]).max()
    later = integrate_peer(made, peer, t0=5.0, t_end=4.0, **size, **start)
    assert (later.t[0], later.t[-1]) == (5.0, 4.0)
    np.testing.assert_allclose(later.q[-1], s.q[-1], atol=1e-12)
