r"""How often the interval of a drift covers the true drift, on artificial series whose drift is known.

A series is

.. math::
    e_n = A\,(\cos(\omega t_n + \phi) + 0.3 \cos(2\omega t_n + 2\phi)) + w_n + r_n + s\,t_n, \qquad t_n = n h,

with log-uniform amplitude A between the powers `AMPLITUDES` of ten, random phase, a period that is no multiple of the
step, white noise w of size `WHITE`, a random walk r of `WALK` a step (round-off by Brouwer's law) and a drift s.
Coverage is counted over `DRAWN` seeded series, and compared with that of ordinary regression (`metrics.slope`).
"""

from __future__ import annotations

import zlib

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.store.cells import Cell, Rows, content

#: log10 of the smallest and the largest amplitude; white noise, random walk a step, drift, and time step.
AMPLITUDES = (-9, -3)
WHITE, WALK, SLOPE, STEP = 1e-12, 1e-15, 1e-14, 0.1
#: Kind of a series -> (white noise, random walk, drift).
KINDS = {
    "oscillation": (0.0, 0.0, 0.0),
    "with white noise": (WHITE, 0.0, 0.0),
    "with a random walk": (0.0, WALK, 0.0),
    "with both and a drift": (WHITE, WALK, SLOPE),
    "with a drift alone": (0.0, 0.0, SLOPE),
}
#: Points of a series, periods over its whole time, and the number of series drawn.
LENGTHS, PERIODS, DRAWN = (400, 5000), (0.5, 1, 2, 4, 10, 25, 70, 190), 400
#: The least number of points in a period.
SAMPLED = 4


def series(
    kind: str, periods: float, points: int, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float]:
    """Draw one series of a ``kind`` of `KINDS`: (t, e, its true drift), with arrays t and e (points,); e begins with 0.

    ``periods`` is the number of periods of the oscillation in the whole series, varied at random by a few percent.
    """
    white, walk, slope = KINDS[kind]
    t = np.arange(points) * STEP
    angle = 2 * np.pi * (periods * generator.uniform(0.95, 1.05) * t / t[-1] + generator.random())
    oscillation = 10 ** generator.uniform(*AMPLITUDES) * (np.cos(angle) + 0.3 * np.cos(2 * angle))
    noise = white * generator.standard_normal(points) + walk * np.cumsum(generator.standard_normal(points))
    e = oscillation + noise + slope * t
    return t, e - e[0], slope


def coverage_row(kind: str, periods: float, points: int, drawn: int = DRAWN) -> dict:
    """Draw series of a kind and count how many of their drift intervals cover the true drift; return a row.

    ``kind``, ``periods`` and ``points`` are those of `series`: a key of `KINDS`, the number of periods of the
    oscillation in the whole series, the number of its points.  ``drawn`` series are drawn.

    The row has the share of intervals that cover and their median half-width, for this project's estimate and for
    ordinary regression (columns with "by the line").
    """
    generator = np.random.default_rng(zlib.crc32(f"{kind} {periods} {points}".encode()))
    ours, lines = [], []
    for _ in range(drawn):
        t, e, slope = series(kind, periods, points, generator)
        for found, estimate in ((ours, drift), (lines, metrics.slope)):
            s = estimate(t, e)
            found.append((s.low <= slope <= s.high, (s.high - s.low) / 2))
    row = {"kind": kind, "points": points, "periods": periods, "drawn": drawn}
    for suffix, found in (("", ours), (" by the line", lines)):
        row[f"covered{suffix}"] = float(np.mean([hit for hit, _ in found]))
        row[f"half-width{suffix}"] = float(np.median([width for _, width in found]))
    return row


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each kind of series, length and number of periods.

    The list is empty if ``quick``.
    """
    found = [(k, p, n) for k in KINDS for n in LENGTHS for p in PERIODS if n >= SAMPLED * p]
    return [] if quick else [_cell(*of) for of in found]


def _cell(kind: str, periods: float, points: int) -> Cell:
    return Cell(
        "drift",
        ("drift_coverage",),
        {"kind": kind, "periods": periods, "points": points},
        measure_rows,
        (kind, periods, points),
        content("drift", kind, periods, points, code=[__name__]),
        frozenset(),
    )


def measure_rows(kind: str, periods: float, points: int) -> Rows:
    """Count how often drift intervals cover the true drift on one kind of artificial series: a row, by table name.

    ``kind`` is a key of `KINDS`, ``periods`` the number of periods of the oscillation in the whole series, ``points``
    the number of its points.
    """
    return {"drift_coverage": [coverage_row(kind, periods, points)]}
