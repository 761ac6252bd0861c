"""``certify``: measure an integrator and judge its claims; the result is a `Certificate`.

from phasebench.benchmarks.certificate.certificate import certify
print(certify("./mine.py", {"order": 4}).verdict)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from phasebench.benchmarks.judge import judge
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.measure.integrator import AnyProblem, Integrator
from phasebench.benchmarks.measure.own_step import OwnStep
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.keywords import check_names
from phasebench.integrators.record import Method
from phasebench.reference.peers import Peer

from . import battery, limited
from .measures import Run, fill_tables
from .result import Certificate
from .subject import Subject, subject


def _certificate(run: Run, times: list[dict]) -> Certificate:
    found = judge.judgements(run.claims, run.tables)
    offers = [] if run.alone or judge.gross_failure(found) else judge.offers(run.claims, run.tables)
    rest = (run.tables, run.doubles, run.requires, run.seed, run.seconds, times)
    return Certificate(run.id, found, offers, judge.verdict(found), *rest)


def certify(
    target: str | Path | Callable[..., Any] | Mapping[str, Any] | Method | Peer | Integrator | OwnStep | Subject,
    claims: Mapping[str, Any] | None = None,
    requires: tuple[str, ...] = (),
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    alone: bool = False,
    problems: Iterable = (),
    time_limit: float | None = None,
) -> Certificate:
    """Measure an integrator on the battery (this suite's test systems) and judge its claims.

    Arguments are as of `validate`.  ``progress`` is called with the name of each measure; if ``alone``, only what is
    claimed is measured, and no further claims are offered.  Raises InvalidInput for arguments that cannot be used;
    failures of the integrator itself are stated in the certificate.
    """
    began = time.perf_counter()
    run = Run(str(getattr(target, "__name__", target)), dict(claims or {}), tuple(requires), seed, alone, Tables())

    def measure(tell: Callable[[str], None], checkpoint: Callable[[Run], None] = lambda run: None) -> Certificate:
        doing = "the start"

        def telling(what: str) -> None:
            nonlocal doing
            doing, run.seconds = what, time.perf_counter() - began
            checkpoint(run)
            tell(what)

        times: list[dict] = []
        try:
            chosen = subject(target, claims, requires)
            run.id, run.claims, run.requires = chosen.id, chosen.own.claims, chosen.own.requires
            run.where = chosen.own.where
            entries = [battery.of_problem(_problem(p)) for p in problems]
            times = fill_tables(chosen, run, entries, telling)
        except limited.OutOfTime as over:
            limited.quiet()
            run.tables.failed["time"] = limited.time_over_message(time_limit or 0.0, over.places, run.where, doing)
        run.seconds = time.perf_counter() - began
        return _certificate(run, times)

    def incomplete(last: Run | None, doing: str, why: str | Sequence[tuple[str, int]], over: bool) -> Certificate:
        last = last or run
        text = limited.time_over_message(time_limit or 0.0, why, last.where, doing) if over else why
        last.tables.failed["time" if over else "raised"] = text
        last.seconds = time.perf_counter() - began
        return _certificate(last, [])

    tell = progress or (lambda what: None)
    problems = tuple(problems)
    return measure(tell) if time_limit is None else limited.within(time_limit, measure, incomplete, tell)


def _problem(named: Any) -> Any:
    return problem_of(named) if isinstance(named, (str, Path)) else named


@check_names
def validate(
    target: str | Path | Callable[..., Any] | Mapping[str, Any] | Method | Peer,
    *,
    order: int | None = None,
    symplectic: bool | None = None,
    symmetric: bool | None = None,
    reversible: bool | None = None,
    volume: bool | None = None,
    energy: Literal["preserved", "bounded", "drift"] | None = None,
    bilinear: Literal["preserved"] | None = None,
    quadratic: Literal["preserved"] | None = None,
    constraints: Literal["preserved"] | None = None,
    stability: float | None = None,
    tolerance: float | None = None,
    precision: Literal["double", "single"] | None = None,
    requires: str | tuple[str, ...] = (),
    output: str | Path | None = None,
    seed: int = 0,
    problem: AnyProblem | Sequence[AnyProblem] = (),
    time_limit: float | None = None,
) -> Certificate:
    """Judge what an integrator claims: ``validate(step, order=4, symplectic=True)``.

    Parameters
    ----------
    target : a function ``step(system, q, p, h) -> (q, p)`` or ``run(system, q, p, t_end, tol) -> (q, p)``, the path of
        a file with one, ``"package.module:callable"``, coefficients (a mapping, or the path of a JSON file), or the id
        of a method or a peer
    order, symplectic, symmetric, reversible, volume, energy, bilinear, quadratic, constraints, stability, tolerance,
    precision : what is claimed: the order, structure of the step, how invariants and constraints are kept, the limit of
        h omega on the oscillator, the largest error in units of the tolerance, the arithmetic
    requires : traits that a system must have, such as "separable"
    output : a folder, into which the certificate is written as Markdown, HTML and JSON
    seed : of the random states at which it is measured
    problem : a name, the path of a file, a problem or several, on which to measure in place of the suite's systems
    time_limit : seconds, after which what is not yet measured is not judged; for a step that may never return

    Returns
    -------
    Certificate
        ``verdict`` is "pass", "fail" or "not-judged", ``claims`` are the judgements, ``offers`` what could be claimed

    Raises
    ------
    InvalidInput
        For a target or a claim that cannot be used.
    """
    given: dict[str, Any] = {
        **{"order": order, "symplectic": symplectic, "symmetric": symmetric, "reversible": reversible},
        **{"volume": volume, "energy": energy, "bilinear": bilinear, "quadratic": quadratic},
        **{"constraints": constraints, "stability": stability, "tolerance": tolerance, "precision": precision},
    }
    claims = {name: value for name, value in given.items() if value is not None}
    requires = (requires,) if isinstance(requires, str) else tuple(requires)
    if output is not None:
        from .render import writable

        writable(output)
    problems = tuple(problem) if isinstance(problem, (list, tuple)) else (problem,)
    found = certify(target, claims, requires, seed, problems=problems, time_limit=time_limit)
    if output is not None:
        from .render import write

        write(found, output)
    return found
