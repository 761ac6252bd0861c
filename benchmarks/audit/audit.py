"""The audit: run established integrators as black boxes and compare what they claim with what is measured.

Methods of this project are audited as controls, and must come out as declared.  See `measures` for how it is measured,
`cases` for the problems, `claims` for the verdicts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks.judge.verdict import CONTRADICTED
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.tabular import TabularResult
from phasebench.integrators.errors import unknown_name
from phasebench.integrators.keywords import check_names
from phasebench.integrators.record import Method
from phasebench.reference.peers import Peer

from . import cases
from .cases import CONTROLS

if TYPE_CHECKING:
    import pandas as pd

#: Time budget in seconds of one measure of one peer, over all its problems.
BUDGET = 10.0
#: The measures of the quick tier, for fixed (False) and adaptive (True) steps, on one problem.
QUICK = {False: ("order", "symplecticity"), True: ("tolerance", "reversibility")}


@dataclass(repr=False)
class Audit(TabularResult):
    """The result of an audit: ``rows`` of measures, ``claims`` with verdicts, ``remarks`` on structures not claimed."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    claims: list[dict[str, Any]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def to_frame(self) -> pd.DataFrame:
        """The judged claims: a row for each, with its verdict and what was measured."""
        import pandas as pd

        return pd.DataFrame(self.claims)

    def _heading(self) -> list[str]:
        peers = len({c["peer"] for c in self.claims})
        return [f"{len(self.claims)} claims of {peers} integrators: {len(self.contradictions)} contradicted"]

    def _printed(self) -> pd.DataFrame:
        return self.to_frame()[["peer", "claim", "verdict"]]

    @property
    def contradictions(self) -> list[dict[str, Any]]:
        """The claims, as dicts (see `claims.judgements`), that a measurement contradicts."""
        return [c for c in self.claims if c["verdict"] == CONTRADICTED]


def select(names: Iterable | None = None) -> list[Integrator]:
    """The integrators with the given ids, packages or records; all peers (those of other packages) if None."""
    from phasebench.reference.peers import BY_ID, PEERS

    if names is None:
        return [integrator(p) for p in PEERS]
    out: list[Integrator] = []
    for name in names:
        if not isinstance(name, str) or name in BY_ID or name in CONTROLS:
            out.append(integrator(name))
        elif of := [p for p in PEERS if p.package == name]:
            out += map(integrator, of)
        else:
            raise unknown_name("peer or package", name, [*BY_ID, *{p.package for p in PEERS}, *CONTROLS])
    first: dict[str, Integrator] = {}
    for chosen in out:
        first.setdefault(chosen.id, chosen)
    return list(first.values())


@check_names
def audit(
    names: Iterable[str | Peer | Method] | None = None,
    *,
    quick: bool = False,
    progress: Callable[[str], None] | None = None,
    budget: float = BUDGET,
    isolate: bool = True,
) -> Audit:
    """Measure peers (integrators of other packages) and judge what their packages claim of them.

    Parameters
    ----------
    names : ids of peers or of controls (methods of this project), names of packages, or records; all peers where None
    quick : run two measures on one problem only
    progress : called with a line of text before each measure
    budget : seconds of one measure of one peer, over all its problems
    isolate : measure in a separate process, which is killed where a package does not return; a record that is in no
        registry is always measured in this process

    Raises
    ------
    InvalidInput
        For a name that is neither a peer nor a package.
    """
    from . import claims, measures, worker

    found = Audit()
    for peer in select(names):
        ask = worker.row_elsewhere if isolate and _is_registered(peer) else worker.row
        tell = progress or (lambda text: None)
        tell(f"{peer.id}: {worker.PREPARE}")
        first = ask(peer, worker.PREPARE, seconds=worker.LOADING)
        rows = [first]
        if first["status"] == "ok":
            for measure in QUICK[peer.adaptive] if quick else measures.ADAPTIVE if peer.adaptive else measures.FIXED:
                on = cases.select(peer, measure, quick)
                for case in on:
                    tell(f"{peer.id}: {measure} on {case.problem}")
                    rows.append(ask(peer, measure, case.problem, budget / len(on)))
        found.rows += rows
        found.claims += claims.judgements(peer, first["version"], rows)
    found.remarks += claims.remarks(found.rows, found.claims)
    return found


def _is_registered(peer: Integrator) -> bool:
    from phasebench.reference.peers import BY_ID

    return (peer.id in BY_ID or peer.id in CONTROLS) and peer == integrator(peer.id)
