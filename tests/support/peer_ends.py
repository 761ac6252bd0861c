"""End states of short runs of peers with fixed steps; ``python tests/support/peer_ends.py`` stores them anew.

Those of packages that are not here stay as they are stored.
"""

from __future__ import annotations

import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from phasebench.reference.installed import is_installed
from phasebench.reference.peers import PEERS, Peer, integrate_peer
from support.solutions import end

STORED = Path(__file__).parents[1] / "reference" / "peer_ends.json"
#: Problem -> (end, steps): a general one, a potential, a perturbed centre and bodies, in few steps.
SPANS = {
    "double-pendulum:regular": (2.0, 5),
    "henon-heiles:box": (2.0, 5),
    "perturbed-kepler": (2.0, 10),
    "n-body": (0.5, 5),
}


@cache
def made(name: str) -> Any:
    return problem(name)


def problems(peer: Peer) -> list[str]:
    """The problems on which a peer runs: REBOUND's on each way to give it a system, others on the first they take."""
    names = [name for name in SPANS if peer.lacks(made(name), made(name).system) is None]
    return names if peer.package == "rebound" else names[:1]


@cache
def exact(name: str, t_end: float, moved: float = 0.0) -> np.ndarray:
    """The state (q, p) at ``t_end`` by DOP853 of this project; ``moved`` is added to each momentum at the start."""
    start = {"q0": made(name).q0, "p0": [x + moved for x in made(name).p0]}
    return end(integrate(made(name), "dop853", t_end=t_end, steps=1000, save_every=0, **start))


def run(peer: Peer, name: str, **more: Any) -> Any:
    t_end, n = SPANS[name]
    return integrate_peer(made(name), peer, **{"h": t_end / n, "steps": n} | more)


def of(peer: Peer) -> dict[str, list]:
    """Problem -> [gradient evaluations, end state]."""
    return {name: [s.counts["gradient"], end(s).tolist()] for name in problems(peer) if (s := run(peer, name))}


if __name__ == "__main__":
    known = json.loads(STORED.read_text()) if STORED.exists() else {}
    found = {p.id: of(p) if is_installed(p.package) else known.get(p.id) for p in PEERS if not p.adaptive}
    lines = [f"{json.dumps(id)}: {json.dumps(ends)}" for id, ends in found.items() if ends]
    STORED.write_text("{\n" + ",\n".join(lines) + "\n}\n")
