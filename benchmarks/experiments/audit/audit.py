"""The audit: established integrators run as black boxes, what they claim against what is measured.

    from phasebench.benchmarks.experiments.audit.audit import audit
    found = audit(["rebound-leapfrog", "scipy"])
    print(found.contradictions)

For each integrator (a peer, or a method of this project as a control, which must come out as declared): order with its
interval, symplecticity and reversibility defects beside what methods of proved structure show through the same
functions, energy error and drift, stability limit, cost.  How it is measured: `measures`; on what: `cases`; what is
concluded: `judge`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.rows.cells import ALONE, Cell, Rows, content
from phasebench.integrators.errors import unknown
from phasebench.integrators.registry import method

from . import cases
from .judge import CONTRADICTED, HOLDS, IN_PART, UNJUDGED

#: Methods of this project that are audited with every run: what is proved of them must come out.
CONTROLS = ("stormer-verlet", "rk4", "scheme-iii", "gauss-2")
#: Seconds of one measure of one peer, over its problems.
BUDGET = 10.0
#: What the quick tier measures, on one problem.
QUICK = {False: ("order", "symplecticity"), True: ("tolerance", "reversibility")}


@dataclass
class Audit:
    """Rows: one for each measure of each peer on each problem, and one for each claim with its verdict."""

    rows: list[dict] = field(default_factory=list)
    claims: list[dict] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def contradictions(self) -> list[dict]:
        """The claims that a measurement contradicts."""
        return [c for c in self.claims if c["verdict"] == CONTRADICTED]


def select(names: Iterable | None = None) -> list[Integrator]:
    """The integrators of those ids, packages or records; all peers where ``names`` is None.

    Raises InvalidInput for a name that is neither, naming the nearest.
    """
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
            raise unknown("peer or package", name, [*BY_ID, *{p.package for p in PEERS}, *CONTROLS])
    first: dict[str, Integrator] = {}
    for chosen in out:
        first.setdefault(chosen.id, chosen)
    return list(first.values())


def audit(
    names: Iterable | None = None,
    quick: bool = False,
    progress: Callable[[str], None] | None = None,
    budget: float = BUDGET,
    isolate: bool = True,
) -> Audit:
    """Measure peers and judge their claims.

    Parameters
    ----------
    names : ids of peers or of controls, names of packages, or records; all peers where None
    quick : two measures on one problem
    progress : told what is measured
    budget : seconds of one measure of one peer
    isolate : measure in a process that is killed where a package does not return; a record that is in no registry is
        measured in this one always

    Raises
    ------
    InvalidInput
        For a name that is neither a peer nor a package.
    """
    from . import judge, measures, worker

    found = Audit()
    for peer in select(names):
        ask = worker.shared().row if isolate and _registered(peer) else worker.row
        tell = partial(_tell, progress, peer.id)
        tell(worker.PREPARE)
        first = ask(peer, worker.PREPARE, seconds=worker.LOADING)
        rows = [first]
        if first["status"] == "ok":
            for measure in QUICK[peer.adaptive] if quick else measures.ADAPTIVE if peer.adaptive else measures.FIXED:
                on = cases.chosen(peer, measure, quick)
                for case in on:
                    tell(f"{measure} on {case.problem}")
                    rows.append(ask(peer, measure, case.problem, budget / len(on)))
        found.rows += rows
        found.claims += judge.claims(peer, first["version"], rows)
    found.remarks += judge.remarks(found.rows, found.claims)
    return found


def _registered(peer: Integrator) -> bool:
    """Whether another process finds the very same integrator under its id."""
    from phasebench.reference.peers import BY_ID

    return (peer.id in BY_ID or peer.id in CONTROLS) and peer == integrator(peer.id)


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each peer and control, each script of a statement and twice each package; none of the quick tier."""
    if quick:
        return []
    from phasebench.reference.peers import PEERS

    from . import modes, statements, unregistered

    own = [_cell(p.id, p, (p.id, p.package)) for p in PEERS] + [_cell(c, method(c), (c,)) for c in CONTROLS]
    return own + statements.cells() + unregistered.cells() + modes.cells(CONTROLS)


def _cell(id: str, record, names: tuple[str, ...]) -> Cell:
    return Cell(
        "audit",
        ("audit", "audit_claims"),
        {"peer": id},
        measured,
        (id,),
        content("audit", record, *map(repr, cases.BY_NAME.values()), code=[__name__]),
        frozenset(names),
        ALONE,
    )


def measured(id: str) -> Rows:
    """The rows and claims of a peer or a control."""
    found = audit([id])
    return {"audit": found.rows, "audit_claims": found.claims}


def _tell(progress, id: str, what: str) -> None:
    if progress is not None:
        progress(f"{id}: {what}")


__all__ = ["BUDGET", "CONTRADICTED", "HOLDS", "IN_PART", "QUICK", "UNJUDGED", "Audit", "audit", "select"]
