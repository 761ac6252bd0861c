"""Our own methods wrapped as peers, so that tests can plant a false claim or a failing run."""

from __future__ import annotations

from phasebench.integrators.registry import method
from phasebench.reference.peers.record import Claims, Peer, Run, Task


def as_peer(record) -> Peer:
    """A `Method` as a peer record that claims what the method declares."""

    def run(task: Task) -> Run:
        from phasebench.integrators.driver import integrate

        every = task.numbers[1]
        s = integrate(task.system, record, h=task.h, steps=task.steps, q0=task.q, p0=task.p, save_every=every)
        return Run(s.q, s.p, s.counts["steps"], s.counts["gradient"], s.seconds, s.reason or None)

    return Peer(
        record.id,
        record.name,
        package="phasebench",
        adaptive=False,
        order=record.order,
        license="MIT",
        about="a control",
        source=record.source,
        run=run,
        lacks=lambda problem, system: record.lacks(system),
        claims=Claims(record.order, record.symplectic, record.symmetric, record.energy, "the registry of methods"),
        load=lambda name: None,
    )


def control(id: str) -> Peer:
    """The method of this project with that id, as a peer."""
    return as_peer(method(id))
