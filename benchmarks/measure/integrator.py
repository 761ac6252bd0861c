"""`Integrator`: one interface, with ``run``, to a method of this project, of another package (peer) or of a user."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.units import span
from phasebench.benchmarks.problems.user_file import is_file
from phasebench.integrators import driver, prepared
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import Parameters, State, Value, method_parameters, rename_arguments
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


@rename_arguments(timeout="time_limit")
@method_parameters(parameters_of)
def integrate(
    problem: AnyProblem,
    method: str | Path | Method | Peer | Integrator | Step,
    *,
    h: float | str | None = None,
    t_end: float | str | None = None,
    steps: int | None = None,
    tol: float | None = None,
    t0: float | str = 0.0,
    q0: State | None = None,
    p0: State | None = None,
    save_every: int = 1,
    t_eval: Sequence[float] | np.ndarray | None = None,
    events: Mapping[str, str] | None = None,
    stop: str | Iterable[str] = (),
    time_limit: float | None = None,
    parameters: Parameters | None = None,
) -> Solution:
    """Integrate a problem with a method of this project, a peer, or a user's own step.

    Parameters
    ----------
    problem : a system; a problem; a registered name such as ``"henon-heiles:box"``; or the path of a file with one
    method : an id of a method or a peer; a record; a function ``step(system, q, p, h) -> (q, p)``; or the path of a
        file with one
    h, t_end, steps : two of them; h alone is adjusted so that a whole number of steps ends at t_end.  For an adaptive
        peer they set the grid of its rows, and t_end alone gives start and end.  If the problem has a unit of time,
        times may have one too: ``h="1 day", t_end="1e4 yr"``.  A t_end before t0, or a negative h with steps, goes back
        in time
    tol : an adaptive peer's tolerance
    t0 : the time at the start; the system does not depend on it
    q0, p0 : arrays (d,), the initial state if not the problem's
    save_every : save every Nth state, and the last; 0 saves the first and the last
    t_eval : array (m,), times at which to save states instead, each by a shorter step from the one before it
    events : functions of the coordinates and momenta whose zeros are wanted, by name: ``{"turn": "x*px + y*py"}``; they
        are found between steps (`section`), in ``events`` of the solution, whatever direction the sign changes in
    stop : name or names of events; the solution ends at the first of them
    time_limit : seconds after which the integration stops with status "timeout"; a peer cannot be stopped
    parameters : values of the method's parameters, ``{"lam": "1/3"}``: numbers, NumPy scalars, fractions or text

    Returns
    -------
    Solution
        t (n,), q and p (n, d), status, reason, counts, seconds; energy(), invariants(), error(), to_frame()

    Raises
    ------
    InvalidInput
        For unusable input; a failure on the way (a blow-up, a stage not solved) is a status instead.

    Examples
    --------
    >>> integrate("pendulum", "scheme-i", h=0.1, steps=10, parameters={"lam": "1/3"}).status
    'ok'
    """
    chosen = integrator(method, parameters=parameters)
    if time_limit is not None and not chosen.stoppable:
        raise InvalidInput(f"'{chosen.id}' cannot be stopped: leave out the time limit")
    found = _problem(problem, chosen, q0)
    unit = getattr(found, "time_unit", "")
    times = {name: span(t, unit, name) for name, t in (("h", h), ("t_end", t_end), ("t0", t0))}
    run = {"steps": steps, "tol": tol, "q0": q0, "p0": p0, "save_every": save_every, "timeout": time_limit, **times}
    if t_eval is None and not events and not stop:
        return Solution.of(chosen.run(found, **run))
    from . import rows

    return rows.integrate(chosen, found, rows.Wanted.of(t_eval, events, stop), **run)


@method_parameters(parameters_of)
def prepare(
    problem: AnyProblem,
    method: str | Path | Method | Peer | Integrator,
    *,
    tol: float | None = None,
    q0: State | None = None,
    p0: State | None = None,
    parameters: Parameters | None = None,
) -> PreparedRun | PreparedPeer:
    """A compiled run for many short integrations: ``run(h, steps)``, or ``run(t_end)`` for an adaptive peer.

    A call consists of a reset to the initial state and the package's own call only; it returns (q, p, status).

    Parameters
    ----------
    problem : a system, if q0 and p0 are given; a problem; a registered name such as ``"henon-heiles:box"``; or the
        path of a file with one
    method, parameters : an id of a method or a peer, or a record; and values of a method's parameters
    tol : an adaptive peer's tolerance
    q0, p0 : arrays (d,), the initial state if not the problem's

    Raises
    ------
    InvalidInput
        For unusable input, or an integrator that cannot be prepared (a user's own step).

    Examples
    --------
    >>> run = prepare("pendulum", "stormer-verlet")
    >>> run(0.01, 100)[2]
    'ok'
    >>> prepare("pendulum", "heyoka", tol=1e-9)(1.0)[2]
    'ok'
    """
    chosen = integrator(method, parameters=parameters)
    return chosen.prepare(_problem(problem, chosen, q0), tol=tol, q0=q0, p0=p0)


def _problem(problem: Any, method: Integrator, q0: State | None) -> Any:
    """The problem, by its name; a bare system gets the Kepler part found at q0 if the method requires one."""
    if isinstance(problem, (str, Path)):
        return problem_of(problem)
    needs = "Kepler part" in getattr(method.record, "requires", ())
    if not needs or q0 is None or not isinstance(problem, PartitionedSystem):
        return problem
    from phasebench.benchmarks.problems.kepler_found import with_kepler_part

    return with_kepler_part(problem, np.asarray(q0, float))
