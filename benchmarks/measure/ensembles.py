"""Ensembles of problems by their name."""

from __future__ import annotations

from pathlib import Path

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators import ensemble
from phasebench.integrators import section as sections
from phasebench.integrators.ensemble import Ensemble
from phasebench.integrators.section import Section


def _made(problem):
    return problem_of(problem) if isinstance(problem, (str, Path)) else problem


def integrate_ensemble(problem, method, Q, P, **options) -> Ensemble:
    """Integrate many orbits, as `integrators.integrate_ensemble`; ``problem`` may be a name or the path of a file.

    Parameters
    ----------
    problem : a system, a problem, a registered name such as ``"henon-heiles"``, or the path of a file with one
    method : an id or a method
    Q, P : arrays (n, d), the initial states
    options : h, t_end, steps, parameters, save_every, lanes, threads, progress

    Returns
    -------
    Ensemble

    Raises
    ------
    InvalidInput
        For input that cannot be used; what happens to an orbit on the way is its status.

    Examples
    --------
    >>> integrate_ensemble("pendulum", "scheme-i", [[1.0], [2.0]], [[0.0], [0.0]], h=0.1, steps=10).status.tolist()
    ['ok', 'ok']
    """
    return ensemble.integrate_ensemble(_made(problem), method, Q, P, **options)


def section(problem, method, Q, P, **options) -> Section:
    """The Poincare section of an ensemble, as `integrators.section.section`; ``problem`` may be a name or a path.

    Parameters
    ----------
    problem, method, Q, P : as of `integrate_ensemble`
    options : of, at, rising, every; h, t_end, steps, parameters, lanes, threads

    Returns
    -------
    Section

    Raises
    ------
    InvalidInput
        For input that cannot be used.

    Examples
    --------
    >>> section("pendulum", "gauss-4", [[1.0]], [[0.0]], of="q", h=0.1, t_end=20.0).counts().tolist()
    [3]
    """
    return sections.section(_made(problem), method, Q, P, **options)
