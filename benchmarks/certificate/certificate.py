"""``certify``: everything measured of an integrator and judged, as one object.

from phasebench.benchmarks.certificate.certificate import certify
print(certify("./mine.py", {"order": 4}).verdict)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks.problems import problem as problem_of

from . import battery, judge, limited
from .measures import measured
from .result import Certificate
from .subject import subject
from .verdicts import Tables

if TYPE_CHECKING:
    import pandas as pd


@dataclass
class _Run:
    """How a certificate is made: what it is of, what was measured so far, and who is told."""

    id: str
    claims: Mapping[str, Any]
    requires: tuple[str, ...]
    seed: int
    alone: bool
    tables: Tables
    where: str = ""
    doubles: str = ""
    seconds: float = 0.0

    def certificate(self, times: list[dict]) -> Certificate:
        """The verdicts on what was measured."""
        found = judge.judged(self.claims, self.tables)
        offers = [] if self.alone or judge.gross_failure(found) else judge.offers(self.claims, self.tables)
        verdict = judge.verdict(found, self.claims)
        rest = (self.tables, self.doubles, self.requires, self.seed, self.seconds, times)
        return Certificate(self.id, found, offers, verdict, *rest)


def certify(
    target,
    claims: Mapping[str, Any] | None = None,
    requires: tuple[str, ...] = (),
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    alone: bool = False,
    problems: Iterable = (),
    time_limit: float | None = None,
) -> Certificate:
    """Measure an integrator on the battery and judge its claims.

    Parameters
    ----------
    target, claims, requires : as of `subject.subject`
    seed : of the states at which it is measured
    progress : told what is measured
    alone : measure what is claimed alone; nothing is offered then
    problems : on which it is measured in place of the battery: names, paths or problems
    time_limit : seconds, after which the rest is not judged

    Raises
    ------
    InvalidInput
        For a target, a claim, a problem or a limit that cannot be used.  What the integrator does wrong is in the
        certificate.
    """
    began = time.perf_counter()
    run = _Run(str(getattr(target, "__name__", target)), dict(claims or {}), tuple(requires), seed, alone, Tables())

    def measure(tell: Callable[[str], None], checkpoint: Callable[[_Run], None] = lambda run: None) -> Certificate:
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
            times = measured(chosen, run, entries, telling)
        except limited.OutOfTime as over:
            limited.quiet()
            run.tables.failed["time"] = limited.said(time_limit or 0.0, over.places, run.where, doing)
        run.seconds = time.perf_counter() - began
        return run.certificate(times)

    def unfinished(last: _Run | None, doing: str, why, over: bool) -> Certificate:
        last = last or run
        text = limited.said(time_limit or 0.0, why, last.where, doing) if over else why
        last.tables.failed["time" if over else "raised"] = text
        last.seconds = time.perf_counter() - began
        return last.certificate([])

    tell = progress or (lambda what: None)
    problems = tuple(problems)
    return measure(tell) if time_limit is None else limited.within(time_limit, measure, unfinished, tell)


def _problem(named):
    return problem_of(named) if isinstance(named, (str, Path)) else named


def validate(
    target,
    *,
    requires: str | tuple[str, ...] = (),
    output: str | Path | None = None,
    seed: int = 0,
    problem=(),
    time_limit: float | None = None,
    **claims,
) -> pd.DataFrame:
    """Judge what an integrator claims: ``validate(step, order=4, symplectic=True)``.

    Parameters
    ----------
    target : a function ``step(system, q, p, h) -> (q, p)`` or ``run(system, q, p, t_end, tol) -> (q, p)``, the path of
        a file with one, ``"package.module:callable"``, coefficients (a mapping, or the path of a JSON file), or the id
        of a method or a peer
    requires : traits of the systems that it can do, such as "separable"
    output : a folder, in which the certificate is written as Markdown, HTML and JSON
    seed : of the states at which it is measured
    problem : one's own, on which it is measured in place of the systems of the suite: a name, the path of a file, a
        problem, or several of them
    time_limit : seconds, after which what is not yet measured is not judged; for a step that may never return
    claims : order, symplectic, symmetric, reversible, energy, bilinear, quadratic, stability, tolerance

    Returns
    -------
    pandas.DataFrame
        A row a claim: claim, verdict ("holds", "contradicted", "not-judged"), measured, interval, on, why.
        ``frame.attrs["verdict"]`` is "pass", "fail" or "not-judged", ``frame.attrs["offers"]`` what could be claimed.

    Raises
    ------
    InvalidInput
        For a target or a claim that cannot be used.
    """
    requires = (requires,) if isinstance(requires, str) else tuple(requires)
    if output is not None:
        from .render import writable

        writable(output)
    problems = tuple(problem) if isinstance(problem, (list, tuple)) else (problem,)
    found = certify(target, claims, requires, seed, problems=problems, time_limit=time_limit)
    if output is not None:
        from .render import write

        write(found, output)
    return found.frame()
