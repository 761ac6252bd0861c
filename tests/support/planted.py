"""Wrap this project's methods as peers (integrators of other packages), so that tests can plant false claims."""

from __future__ import annotations

from phasebench.integrators.registry import method
from phasebench.reference.peers.record import Claims, Peer, Run, Task


def control(id: str) -> Peer:
    """The method with this id as the record of a peer, another package's integrator, that claims what it declares."""
    record = method(id)

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
