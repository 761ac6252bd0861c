"""This project's own methods put through the audit as if they were peers: what is proved of them must come out.

A `Method` becomes a record `Peer` whose claims are what the registry declares.
"""

from __future__ import annotations

from functools import lru_cache

from phasebench.reference.peers.record import Claims, Peer, Run, Task

#: Audited with every run.
CONTROLS = ("stormer-verlet", "rk4", "scheme-iii", "gauss-2")


def as_peer(method) -> Peer:
    """The record of a `Method`; its claims are its declarations."""

    def run(task: Task) -> Run:
        from phasebench.integrators.driver import integrate

        every = task.numbers[1]
        s = integrate(task.system, method, h=task.h, steps=task.steps, q0=task.q, p0=task.p, save_every=every)
        return Run(s.q, s.p, s.counts["steps"], s.counts["gradient"], s.seconds, s.reason or None)

    return Peer(
        method.id,
        method.name,
        package="phasebench",
        adaptive=False,
        order=method.order,
        license="MIT",
        about="a control",
        source=method.source,
        run=run,
        lacks=lambda problem, system: method.lacks(system),
        claims=Claims(method.order, method.symplectic, method.symmetric, method.energy, "the registry of methods"),
        load=lambda name: None,
    )


@lru_cache(maxsize=32)
def control(id: str) -> Peer:
    """The method of that id as a peer."""
    from phasebench.integrators.registry import method

    return as_peer(method(id))
