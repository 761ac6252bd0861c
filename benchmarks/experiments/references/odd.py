"""Uncertainties of reference states at times between the stored ones, judged by a run in many bits.

For each orbit, `TIMES` times are drawn with a fixed seed over its span.  At each, the state and its uncertainty are
computed as they are for measuring the error of a user's run (`measure.truths`).  The state's own error is its distance
from a Taylor run in `MANY` bits, or, above `LARGEST` degrees of freedom, in quadruple precision.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.problems import labels, problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.reference.certificates import followed
from phasebench.reference.certificates.along import norm
from phasebench.reference.certificates.horizon import LIMIT
from phasebench.reference.solvers import taylor

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

ODD = "references_odd"
#: Number of times of an orbit; the earliest, as a share of its span; the seed.
TIMES, FIRST, SEED = 20, 0.01, 25
#: Bits and tolerance of the exact run; its largest number of degrees of freedom; bits of quadruple precision.
MANY, TOLERANCE, LARGEST, QUADRUPLE = 240, "1e-60", 9, 113


def cells() -> list[Cell]:
    """List the measurements (`Cell`), one for each orbit with stored states."""
    return [_cell(label) for label in labels()]


def _cell(label: str) -> Cell:
    id = label.partition(":")[0]
    return Cell(
        "references",
        (ODD,),
        {"problem": label},
        measure_rows,
        (label,),
        content(ODD, ProblemKey(label), code=(__name__,)),
        frozenset({id}),
    )


def times(made: Problem, count: int = TIMES) -> list[float]:
    """Return ``count`` random times, ascending, between the stored ones of the orbit of the problem ``made``."""
    random = np.random.default_rng([SEED, crc32(made.label.encode())])
    return sorted(float(t) for t in made.start.times[-1] * random.uniform(FIRST, 1.0, count))


def error_rows(made: Problem, at: list[float]) -> list[dict[str, object]]:
    """Measure the reference state of the problem ``made`` at the times ``at``: a row for each.

    A row has the error of the state, its stated uncertainty, and the numbers from which the uncertainty was estimated.
    """
    many = made.system.d <= LARGEST
    number = taylor.Bits(MANY) if many else taylor.extended_types()[1]
    exact = taylor.states(made.system, number, made.q0, made.p0, at, TOLERANCE if many else None)
    rows = []
    for t, state in zip(at, exact, strict=True):
        runs = followed.follow(made, [t])
        true = truths.of_runs(made, END_STATE, runs)
        size = float(np.abs(true.values).max())
        rows.append(
            {
                "problem": made.label,
                "t": t,
                "bits": MANY if many else QUADRUPLE,
                "size": size,
                "error": norm(true.values, state, number),
                "uncertainty": true.uncertainty,
                "long double": norm(runs.one[-1], state, number),
                "rounding": true.rounding,
                "two runs": float(np.abs(runs.one[-1] - runs.other[-1]).max()),
                "early": bool(true.rounding <= LIMIT * size),
                "source": true.source,
            }
        )
    return rows


def measure_rows(label: str) -> Rows:
    """Measure the errors of an orbit's reference states at random times; ``label`` is the orbit, "problem:orbit".

    Returns the rows by table name, a row for each time.
    """
    made = problem(label)
    return {ODD: error_rows(made, times(made))}


def beyond(rows: list[dict]) -> list[str]:
    """Return a message for each reference state whose error is above its stated uncertainty.

    ``rows`` are those of `error_rows`, one for each state.
    """
    return [
        f"{r['problem']} at t = {float(r['t']):g}: {float(r['uncertainty']):.2g} is stated, the error is "
        f"{float(r['error']):.2g}"
        for r in rows
        if not float(r["error"]) <= float(r["uncertainty"])
    ]
