"""Uncertainties at times of which no state is stored: each is judged by a run in many bits.

Of each orbit `TIMES` are drawn, seeded, over its whole span.  At each the state and its uncertainty are computed as for
`integrate --error` and the advice (`measure.truths`); its error is its distance from a Taylor run in `MANY` bits, or,
above `LARGEST` degrees of freedom, in quadruple precision.
"""

from __future__ import annotations

from zlib import crc32

import numpy as np

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.problems import labels, problem
from phasebench.benchmarks.rows.cells import Cell, Problem, Rows, content
from phasebench.reference.certificates import followed
from phasebench.reference.certificates.along import norm
from phasebench.reference.certificates.horizon import LIMIT
from phasebench.reference.solvers import taylor

ODD = "references_odd"
#: Times of an orbit, drawn between this share of its span and its end; their seed.
TIMES, FIRST, SEED = 20, 0.01, 25
#: What errors are measured with: bits and tolerance, and up to how many degrees of freedom.
MANY, TOLERANCE, LARGEST, QUADRUPLE = 240, "1e-60", 9, 113


def cells() -> list[Cell]:
    """A cell for each orbit of which states are stored."""
    return [_cell(label) for label in labels()]


def _cell(label: str) -> Cell:
    id = label.partition(":")[0]
    return Cell(
        "references",
        (ODD,),
        {"problem": label},
        measured,
        (label,),
        content(ODD, Problem(label), code=(__name__,)),
        frozenset({id}),
    )


def times(made, count: int = TIMES) -> list[float]:
    """So many times of an orbit, none of which a state is stored at."""
    random = np.random.default_rng([SEED, crc32(made.label.encode())])
    return sorted(float(t) for t in made.start.times[-1] * random.uniform(FIRST, 1.0, count))


def judged(made, at: list[float]) -> list[dict[str, object]]:
    """A row for each of the times: the error of what is told there, and the uncertainty that is stated of it."""
    many = made.system.d <= LARGEST
    number = taylor.Bits(MANY) if many else taylor.extended()[1]
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


def measured(label: str) -> Rows:
    """The rows of an orbit."""
    made = problem(label)
    return {ODD: judged(made, times(made))}


def beyond(rows: list[dict]) -> list[str]:
    """In words, the rows whose error is above the uncertainty that is stated."""
    return [
        f"{r['problem']} at t = {float(r['t']):g}: {float(r['uncertainty']):.2g} is stated, the error is "
        f"{float(r['error']):.2g}"
        for r in rows
        if not float(r["error"]) <= float(r["uncertainty"])
    ]
