"""`Integrator`: a method of this project, a peer or a stranger's step, with one ``run`` whatever it is."""

from __future__ import annotations

from dataclasses import dataclass

from phasebench.integrators.driver import Solution, integrate
from phasebench.integrators.errors import InvalidInput, unknown
from phasebench.integrators.record import Method
from phasebench.integrators.registry import BY_ID as METHODS_BY_ID
from phasebench.integrators.registry import method
from phasebench.reference.peers import BY_ID as PEERS_BY_ID
from phasebench.reference.peers import Peer, integrate_peer

#: The kind of an integrator of this project; a peer's is its package.
OURS = "phasebench"


@dataclass(frozen=True)
class Integrator:
    """Something that integrates.

    Attributes
    ----------
    record : the method with its parameters, or the peer
    """

    record: Method | Peer

    @property
    def id(self) -> str:
        """Its kebab-case name."""
        return self.record.id

    @property
    def label(self) -> str:
        """The id with its parameters, as in ``scheme-i(lam=1/3)``."""
        return self.record.label

    @property
    def kind(self) -> str:
        """`OURS`, or the package of a peer."""
        return self.record.package if isinstance(self.record, Peer) else OURS

    @property
    def adaptive(self) -> bool:
        """Whether it takes a tolerance in place of a step."""
        return isinstance(self.record, Peer) and self.record.adaptive

    @property
    def order(self) -> int | None:
        """The order in the step that is declared; None where it is not one number."""
        return self.record.order

    def lacks(self, problem) -> str | None:
        """Why it cannot integrate a problem, or None where it can."""
        if isinstance(self.record, Peer):
            return self.record.lacks(problem, problem.system)
        return self.record.lacks(problem.system)

    def run(
        self,
        problem,
        *,
        h: float | None = None,
        t_end: float | None = None,
        steps: int | None = None,
        tol: float | None = None,
        q0=None,
        p0=None,
        save_every: int = 1,
        timeout: float | None = None,
    ) -> Solution:
        """Integrate ``problem``; an adaptive one takes ``tol``, and ``h`` as the spacing of its rows.

        A peer cannot be stopped: ``timeout`` is of this project's methods alone.  Raises InvalidInput as
        `integrators.driver.integrate` does, and for a tolerance where there is none.
        """
        common = {"h": h, "t_end": t_end, "steps": steps, "q0": q0, "p0": p0, "save_every": save_every}
        if isinstance(self.record, Peer):
            return integrate_peer(problem, self.record, tol=tol, **common)
        if tol is not None:
            raise InvalidInput(f"'{self.id}' takes a step h, no tolerance")
        return integrate(problem, self.record, timeout=timeout, **common)


def integrator(name: str | Method | Peer | Integrator, **parameters) -> Integrator:
    """The integrator of that id (of a method or a peer) or record, with values for a method's parameters.

    Raises
    ------
    InvalidInput
        For an unknown id, naming the nearest, or parameters that it does not have.
    """
    if isinstance(name, Integrator):
        name = name.record
    if isinstance(name, str) and name not in METHODS_BY_ID:
        if name not in PEERS_BY_ID:
            raise unknown("method", name, [*METHODS_BY_ID, *PEERS_BY_ID])
        name = PEERS_BY_ID[name]
    if isinstance(name, Peer):
        if parameters:
            raise InvalidInput(f"'{name.id}' has no parameters; it takes h or tol")
        return Integrator(name)
    return Integrator(method(name, **parameters))
