"""`Integrator`: a method of this project, a peer or a step of the user's own, with one ``run`` whatever it is."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.units import span
from phasebench.benchmarks.problems.user_file import is_file
from phasebench.integrators import driver, prepared
from phasebench.integrators.errors import InvalidInput, unknown
from phasebench.integrators.prepared import PreparedRun
from phasebench.integrators.record import Method
from phasebench.integrators.registry import BY_ID as METHODS_BY_ID
from phasebench.integrators.registry import method
from phasebench.reference import peers
from phasebench.reference.peers import Claims, Peer, integrate_peer
from phasebench.reference.peers.prepared import PreparedPeer, prepare_peer

from . import coefficients, own_step
from .own_step import OwnStep
from .solution import Solution

#: The kinds of integrators besides those of a package.
OURS, YOURS = "phasebench", "own step"


@dataclass(frozen=True)
class Integrator:
    """Something that integrates.

    Attributes
    ----------
    record : the method with its parameters, the peer, or the step of the user's own
    """

    record: Method | Peer | OwnStep

    @property
    def id(self) -> str:
        """Its kebab-case name, or the path of its file."""
        return self.record.id

    @property
    def label(self) -> str:
        """The id with its parameters, as in ``scheme-i(lam=1/3)``."""
        return self.record.label

    @property
    def name(self) -> str:
        """Its full name, where it has another than its id."""
        return getattr(self.record, "name", self.id)

    @property
    def kind(self) -> str:
        """`OURS`, `YOURS`, or the package of a peer."""
        if isinstance(self.record, Peer):
            return self.record.package
        return YOURS if isinstance(self.record, OwnStep) else OURS

    @property
    def adaptive(self) -> bool:
        """Whether it takes a tolerance in place of a step."""
        return isinstance(self.record, Peer) and self.record.adaptive

    @property
    def stoppable(self) -> bool:
        """Whether a time limit ends its run: not that of a peer, whose package runs to its end."""
        return not isinstance(self.record, Peer)

    @property
    def preparable(self) -> bool:
        """Whether it has a prepared run: not a step of one's own, and not every peer."""
        record = self.record
        return isinstance(record, Method) or (isinstance(record, Peer) and record.prepare is not None)

    @property
    def order(self) -> int | None:
        """The order in the step that is declared; None where it is not one number."""
        return self.record.order

    @property
    def claims(self) -> Claims:
        """What is claimed of it: by a method's record, by a peer's package, by the file of a step."""
        record = self.record
        if isinstance(record, Peer):
            return record.claims
        if isinstance(record, OwnStep):
            return Claims(*map(record.claims.get, ("order", "symplectic", "reversible", "energy")), record.id)
        return Claims(record.order, record.symplectic, record.symmetric, record.energy, "the registry of methods")

    def load(self) -> None:
        """Import the package of a peer; raises ImportError where it is not there."""
        if isinstance(self.record, Peer):
            self.record.load(self.record.package)

    def _refused(self, problem) -> str | None:
        """Why a problem, where it is more than a system, is not for it."""
        return problem.refuses(self.record) if hasattr(problem, "refuses") else None

    def lacks(self, problem) -> str | None:
        """Why it cannot integrate a problem, or None where it can."""
        system = getattr(problem, "system", problem)
        refused = self._refused(problem)
        if refused:
            return refused
        return self.record.lacks(problem, system) if isinstance(self.record, Peer) else self.record.lacks(system)

    def prepare(self, problem, *, tol: float | None = None, q0=None, p0=None) -> PreparedRun | PreparedPeer:
        """Its compiled run on a problem; raises InvalidInput where it has none, and as `run` does."""
        if isinstance(self.record, Peer):
            return prepare_peer(problem, self.record, tol=tol, q0=q0, p0=p0)
        if tol is not None:
            raise InvalidInput(f"'{self.id}' takes a step h, no tolerance")
        if isinstance(self.record, OwnStep):
            raise InvalidInput(f"'{self.id}' is called from Python and has no prepared run; pb.integrate runs it")
        return prepared.prepare(problem, self.record, q0=q0, p0=p0)

    def run(
        self,
        problem,
        *,
        h: float | None = None,
        t_end: float | None = None,
        steps: int | None = None,
        tol: float | None = None,
        t0: float = 0.0,
        q0=None,
        p0=None,
        save_every: int = 1,
        timeout: float | None = None,
    ) -> Solution:
        """Integrate ``problem``; an adaptive one takes ``tol``, and ``h`` as the spacing of its rows.

        A ``timeout`` has no effect on one that is not `stoppable`.  Raises InvalidInput as
        `integrators.driver.integrate` does, and for a tolerance where there is none.
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


def integrator(name: str | Path | Method | Peer | OwnStep | Integrator | Callable, **parameters) -> Integrator:
    """What a name stands for: the id of a method or a peer, the path of a file; or a record, or a step.

    Parameters
    ----------
    name : an id; the path of a file with a step (``./mine.py``, ``./mine.py:object.step``) or with coefficients
        (``./mine.json``); a record; or a function ``step(system, q, p, h) -> (q, p)``
    parameters : values of a method's parameters

    Raises
    ------
    InvalidInput
        For an unknown id, naming the nearest, parameters that it does not have, or a file without a step.
    """
    record = name.record if isinstance(name, Integrator) else name
    if isinstance(record, Path) or (isinstance(record, str) and is_file(record)):
        path = str(record)
        record = coefficients.from_file(path) if path.lower().endswith(".json") else own_step.from_file(path)
    elif isinstance(record, str) and record not in METHODS_BY_ID:
        if record not in peers.BY_ID:
            raise unknown("method", record, [*METHODS_BY_ID, *peers.BY_ID])
        record = peers.BY_ID[record]
    elif callable(record) and not isinstance(record, Method):
        record = own_step.from_function(record)
    if isinstance(record, (str, Method)):
        return Integrator(method(record, **parameters))
    if not isinstance(record, (Peer, OwnStep)):
        raise InvalidInput(
            f"the method is {name!r}; give an id, a method, a step (system, q, p, h) -> (q, p), or a path"
        )
    if parameters:
        takes = "h or tol" if isinstance(record, Peer) else "h"
        raise InvalidInput(f"'{record.id}' has no parameters such as {', '.join(parameters)}; it takes {takes}")
    return Integrator(record)


def integrate(
    problem,
    method: str | Path | Method | Peer | Callable,
    *,
    h: float | None = None,
    t_end: float | str | None = None,
    steps: int | None = None,
    tol: float | None = None,
    t0: float = 0.0,
    q0=None,
    p0=None,
    save_every: int = 1,
    timeout: float | None = None,
    **parameters,
) -> Solution:
    """Integrate a problem with a method of this project, a peer, or a step of one's own.

    Parameters
    ----------
    problem : a system; a problem; a registered name such as ``"henon-heiles:box"``; or the path of a file with one
    method : an id of a method or a peer; a record; a function ``step(system, q, p, h) -> (q, p)``; or the path of a
        file with one
    h, t_end, steps : two of them; h alone is adjusted so that a whole number of steps ends at t_end.  Of an adaptive
        peer they make the grid of its rows, and t_end alone gives start and end.  Where the problem has a unit of
        time, t_end may have one: ``"1e4 yr"``.  A t_end before t0, or a negative h with steps, goes back in time
    tol : an adaptive peer's tolerance
    t0 : the time at the start; the system does not depend on it
    q0, p0 : arrays (d,), the initial state where not the problem's
    save_every : keep every so many-th state, and the last; 0 keeps the first and the last
    timeout : seconds after which the integration stops with status "timeout"; a peer cannot be stopped
    parameters : values of the method's parameters, ``lam=0.5``: numbers, scalars of NumPy, fractions or "1/3"

    Returns
    -------
    Solution
        t (n,), q and p (n, d), status, reason, counts, seconds; energy(), invariants(), error(), to_frame()

    Raises
    ------
    InvalidInput
        For input that cannot be used; what happens on the way (a blow-up, a stage not solved) is a status.

    Examples
    --------
    >>> integrate("pendulum", "scheme-i", h=0.1, steps=10, lam="1/3").status
    'ok'
    """
    try:
        method = integrator(method, **parameters)
    except InvalidInput as error:
        raise InvalidInput(f"{error}{_misspelt(parameters)}") from None
    if timeout is not None and not method.stoppable:
        raise InvalidInput(f"'{method.id}' cannot be stopped: leave out the time limit")
    problem = problem_of(problem) if isinstance(problem, (str, Path)) else problem
    t_end = span(t_end, getattr(problem, "time_unit", ""))
    grid = {"h": h, "t_end": t_end, "steps": steps, "tol": tol, "t0": t0}
    return Solution.of(method.run(problem, q0=q0, p0=p0, save_every=save_every, timeout=timeout, **grid))


def prepare(
    problem,
    method: str | Method | Peer,
    *,
    tol: float | None = None,
    q0=None,
    p0=None,
    **parameters,
) -> PreparedRun | PreparedPeer:
    """A compiled run for many short integrations: ``run(h, steps)``, or ``run(t_end)`` of an adaptive peer.

    A call makes the package's own call and a reset to the initial state, and nothing else; it returns (q, p, code).

    Parameters
    ----------
    problem : a system, where q0 and p0 are given; a problem; a registered name such as ``"henon-heiles:box"``; or the
        path of a file with one
    method, parameters : an id of a method or a peer, or a record; and values of a method's parameters
    tol : an adaptive peer's tolerance
    q0, p0 : arrays (d,), the initial state where not the problem's

    Raises
    ------
    InvalidInput
        For input that cannot be used, or an integrator that has no prepared run (a step of one's own).

    Examples
    --------
    >>> run = prepare("pendulum", "stormer-verlet")
    >>> q, p, code = run(0.01, 100)
    >>> code == run.SOLVED
    True
    >>> q, p, code = prepare("pendulum", "heyoka", tol=1e-9)(1.0)
    >>> code == 0
    True
    """
    problem = problem_of(problem) if isinstance(problem, (str, Path)) else problem
    return integrator(method, **parameters).prepare(problem, tol=tol, q0=q0, p0=p0)


def _misspelt(names) -> str:
    """What follows an error where a name is near to one of `integrate`'s own arguments."""
    known = [name for name in inspect.signature(integrate).parameters if name != "parameters"]
    near = [match for name in names for match in difflib.get_close_matches(name, known)]
    return f"; did you mean {' or '.join(near)}?" if near else ""
