"""`Integrator`: one interface, with ``run``, to a method of this project, of another package (peer) or of a user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.user_file import is_file
from phasebench.integrators import driver, prepared
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import Parameters, State, Value, method_parameters
from phasebench.integrators.names import unknown_method
from phasebench.integrators.prepared import PreparedRun
from phasebench.integrators.record import Method
from phasebench.integrators.registry import BY_ID as METHODS_BY_ID
from phasebench.integrators.registry import method as method_of
from phasebench.integrators.registry import parameter_names
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.reference import peers
from phasebench.reference.installed import is_installed
from phasebench.reference.peers import Claims, Peer, integrate_peer
from phasebench.reference.peers.prepared import PreparedPeer, prepare_peer

from . import own_step
from .own_step import OwnStep, Step
from .solution import Solution

#: The kinds of integrators besides packages.
OURS, YOURS = "phasebench", "own step"

#: What a problem may be given as: a name, the path of a file, a problem, or a system.
AnyProblem = str | Path | Problem | PartitionedSystem


@dataclass(frozen=True)
class Integrator:
    """A method of this project, a peer (integrator of another package) or a user's own step, behind one interface.

    ``record`` is the method with its parameters, the peer, or the user's own step.
    """

    record: Method | Peer | OwnStep

    @property
    def id(self) -> str:
        """The integrator's kebab-case name, or the path of its file."""
        return self.record.id

    @property
    def label(self) -> str:
        """The id with its parameters, as in ``scheme-i(lam=1/3)``."""
        return self.record.label

    @property
    def name(self) -> str:
        """The integrator's full name if it has one, else its id."""
        return getattr(self.record, "name", self.id)

    @property
    def kind(self) -> str:
        """Its origin: `OURS` (this project), `YOURS` (a user's step), or the name of a peer's package."""
        if isinstance(self.record, Peer):
            return self.record.package
        return YOURS if isinstance(self.record, OwnStep) else OURS

    @property
    def adaptive(self) -> bool:
        """True if the integrator takes a tolerance instead of a step."""
        return isinstance(self.record, Peer) and self.record.adaptive

    @property
    def rows_end_steps(self) -> bool:
        """True if it is an adaptive peer whose steps end at rows: a run with rows is another one than without."""
        return getattr(self.record, "rows_end_steps", False)

    @property
    def stoppable(self) -> bool:
        """True if a time limit can stop its run; a peer's package runs to its end."""
        return not isinstance(self.record, Peer)

    @property
    def preparable(self) -> bool:
        """True if its set-up can be done once and reused for repeated timed runs; a user's own step has none."""
        record = self.record
        return isinstance(record, Method) or (isinstance(record, Peer) and record.prepare is not None)

    @property
    def order(self) -> int | None:
        """The declared order in h; None if it is not a single number."""
        return self.record.order

    @property
    def claims(self) -> Claims:
        """The claims made by a method's record, a peer's package or the file of a step."""
        record = self.record
        if isinstance(record, Peer):
            return record.claims
        if isinstance(record, OwnStep):
            return Claims(*map(record.claims.get, ("order", "symplectic", "reversible", "energy")), record.id)
        reversible = record.symmetric and record.one_step
        return Claims(record.order, record.symplectic, reversible, record.energy, "the registry of methods")

    @property
    def installed(self) -> bool:
        """True unless it is a peer whose package is not installed."""
        return not isinstance(self.record, Peer) or is_installed(self.record.package)

    def load(self) -> None:
        """Import the package of a peer; raises ImportError if it is not installed."""
        if isinstance(self.record, Peer):
            self.record.load(self.record.package)

    def _refused(self, problem: Any) -> str | None:
        return problem.refuses(self.record) if hasattr(problem, "refuses") else None

    def lacks(self, problem: Any) -> str | None:
        """Return the reason why the integrator cannot integrate a problem or a bare system, or None if it can."""
        system = getattr(problem, "system", problem)
        refused = self._refused(problem)
        if refused:
            return refused
        return self.record.lacks(problem, system) if isinstance(self.record, Peer) else self.record.lacks(system)

    def prepare(
        self,
        problem: Any,
        *,
        tol: float | None = None,
        q0: State | None = None,
        p0: State | None = None,
    ) -> PreparedRun | PreparedPeer:
        """Make a prepared (compiled) run on a problem, for repeated short calls: ``run(h, steps)`` or ``run(t_end)``.

        Raises InvalidInput as `run` does, and for a user's own step, which has none.
        """
        if isinstance(self.record, Peer):
            return prepare_peer(problem, self.record, tol=tol, q0=q0, p0=p0)
        if tol is not None:
            raise InvalidInput(f"'{self.id}' takes a step h, no tolerance")
        if isinstance(self.record, OwnStep):
            raise InvalidInput(f"'{self.id}' is called from Python and has no prepared run; pb.integrate runs it")
        return prepared.prepare(problem, self.record, q0=q0, p0=p0)

    def run(
        self,
        problem: Any,
        *,
        h: float | None = None,
        t_end: float | None = None,
        steps: int | None = None,
        tol: float | None = None,
        t0: float = 0.0,
        q0: State | None = None,
        p0: State | None = None,
        save_every: int = 1,
        timeout: float | None = None,
    ) -> Solution:
        """Integrate ``problem`` and return the solution; the arguments are those of `integrate`.

        A ``timeout`` has no effect on an integrator that is not `stoppable`.  Raises InvalidInput as
        `integrators.driver.integrate` does, and for a tolerance given to an integrator with fixed steps.
        """
        refused = self._refused(problem)
        if refused:
            raise InvalidInput(refused)
        common = {"h": h, "t_end": t_end, "steps": steps, "t0": t0, "q0": q0, "p0": p0, "save_every": save_every}
        if isinstance(self.record, Peer):
            return integrate_peer(problem, self.record, tol=tol, **common)
        if tol is not None:
            raise InvalidInput(f"'{self.id}' takes a step h, no tolerance")
        run = own_step.integrate_step if isinstance(self.record, OwnStep) else driver.integrate
        return run(problem, self.record, timeout=timeout, **common)


def parameters_of(method: object) -> list[str]:
    """Return the names of a method's parameters; ``method`` is its id, record or `Integrator`, [] for anything else."""
    record = method.record if isinstance(method, Integrator) else method
    return parameter_names(record) if isinstance(record, (str, Method)) else []


@method_parameters(parameters_of)
def integrator(
    method: str | Path | Method | Peer | OwnStep | Integrator | Step, *, parameters: Parameters | None = None
) -> Integrator:
    """Make the `Integrator` of a method of this project, a peer (another package's integrator) or a user's own step.

    Parameters
    ----------
    method : id of a method or a peer; path of a file with a step (``./mine.py``, ``./mine.py:object.step``) or with
        coefficients (``./mine.json``); a record; or a function ``step(system, q, p, h) -> (q, p)``
    parameters : values of a method's parameters, ``{"lam": "1/3"}``

    Raises
    ------
    InvalidInput
        For an unknown id, with the nearest known one, for unknown parameters, or for a file without a step.
    """
    given = _mapping(parameters)
    record: object = method.record if isinstance(method, Integrator) else method
    if isinstance(record, Path) or (isinstance(record, str) and is_file(record)):
        from . import coefficients

        path = str(record)
        record = coefficients.from_file(path) if path.lower().endswith(".json") else own_step.from_file(path)
    elif isinstance(record, str) and record not in METHODS_BY_ID:
        if record not in peers.BY_ID:
            raise unknown_method(record, [*METHODS_BY_ID, *peers.BY_ID])
        record = peers.BY_ID[record]
    elif callable(record) and not isinstance(record, Method):
        record = own_step.from_function(record)
    if isinstance(record, (str, Method)):
        return Integrator(method_of(record, **given))
    if not isinstance(record, (Peer, OwnStep)):
        raise InvalidInput(
            f"the method is {method!r}; give an id, a method, a step (system, q, p, h) -> (q, p), or a path"
        )
    if given:
        takes = "h or tol" if isinstance(record, Peer) else "h"
        raise InvalidInput(f"'{record.id}' has no parameters such as {', '.join(given)}; it takes {takes}")
    return Integrator(record)


def _mapping(parameters: object) -> dict[str, Value]:
    if parameters is None:
        return {}
    if not isinstance(parameters, Mapping) or not all(isinstance(name, str) for name in parameters):
        raise InvalidInput(f"parameters is {parameters!r}; it must map names to values, as {{'lam': '1/3'}}")
    return dict(parameters)
