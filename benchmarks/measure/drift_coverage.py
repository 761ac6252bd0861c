r"""How often the interval of a drift covers the true drift, on artificial series whose drift is known.

A series is

.. math::
    e_n = A\,(\cos(\omega t_n + \phi) + 0.3 \cos(2\omega t_n + 2\phi)) + w_n + r_n + s\,t_n, \qquad t_n = n h,

with log-uniform amplitude A between the powers `AMPLITUDES` of ten, random phase, a period that is no multiple of the
step, white noise w of size `WHITE`, a random walk r of `WALK` a step (round-off by Brouwer's law) and a drift s.  Other
kinds (`KINDS`) have a peaked oscillation or none, or bursts of noise at random times.
Coverage is counted over `DRAWN` seeded series, and compared with that of ordinary regression (`metrics.slope`).
"""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np

from . import metrics
from .drift import drift

#: log10 of the smallest and the largest amplitude; white noise, random walk a step, drift, and time step.
AMPLITUDES = (-9, -3)
WHITE, WALK, SLOPE, STEP = 1e-12, 1e-15, 1e-14, 0.1
#: Points of a series, periods over its whole time (0: no oscillation), and the number of series drawn.
LENGTHS, PERIODS, DRAWN = (400, 5000), (0.5, 1, 2, 4, 10, 25, 70, 190), 400
#: The least number of points in a period.
SAMPLED = 4
#: A peaked oscillation is 1 / (1 - PEAKED cos); in a burst white noise is this many times as large.
PEAKED, BURST = 0.9, 30.0
#: A drift in white noise, in standard errors of a line; it must be seen where that line's t-value is above `SURE`.
CLIMB, SURE = 9.0, 8.0


class Kind(NamedTuple):
    """A kind of series: its oscillation ("harmonic", "peaked" or ""), white noise, random walk, drift, and bursts."""

    oscillation: str = "harmonic"
    white: float = 0.0
    walk: float = 0.0
    slope: float = 0.0
    bursts: int = 0


KINDS = {
    "oscillation": Kind(),
    "with white noise": Kind(white=WHITE),
    "with a random walk": Kind(walk=WALK),
    "with both and a drift": Kind(white=WHITE, walk=WALK, slope=SLOPE),
    "with a drift alone": Kind(slope=SLOPE),
    "peaked": Kind("peaked"),
    "peaked, with white noise": Kind("peaked", white=WHITE),
    "white noise alone": Kind("", white=WHITE),
    "random walk alone": Kind("", walk=WALK),
    "bursts": Kind("", white=WHITE, bursts=8),
}


def series(
    kind: str, periods: float, points: int, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw one series of a ``kind`` of `KINDS`: times, oscillation, and noise, arrays (points,), without its drift.

    ``periods`` is the number of periods of the oscillation, if it has one, varied at random by a few percent.
    """
    of = KINDS[kind]
    t = np.arange(points) * STEP
    noise, steps = generator.standard_normal((2, points))
    size = np.full(points, of.white)
    for _ in range(of.bursts):
        place, width = generator.uniform(0, t[-1]), t[-1] * generator.uniform(0.01, 0.04)
        size += BURST * of.white * np.exp(-(((t - place) / width) ** 2))
    noise = size * noise + of.walk * np.cumsum(steps)
    if not of.oscillation:
        return t, np.zeros(points), noise
    angle = 2 * np.pi * (periods * generator.uniform(0.95, 1.05) * t / t[-1] + generator.random())
    form = 1 / (1 - PEAKED * np.cos(angle)) if of.oscillation == "peaked" else np.cos(angle) + 0.3 * np.cos(2 * angle)
    return t, 10 ** generator.uniform(*AMPLITUDES) * form, noise


def coverage(kind: str, periods: float, points: int, drawn: int = DRAWN) -> dict:
    """The share of intervals that cover the true drift of ``drawn`` `series`, and their median half-width.

    Columns "by the line" are those of ordinary regression.  If the noise is white, ``seen`` is the share of series in
    which a drift of `CLIMB` standard errors is seen, of those where a line through noise and drift alone has a t-value
    above `SURE`; else it is NaN.
    """
    generator = np.random.default_rng(zlib.crc32(f"{kind} {periods} {points}".encode()))
    of, ours, lines, seen = KINDS[kind], [], [], []
    tells = of.oscillation != "peaked" and of.white > 0 and not (of.walk or of.slope or of.bursts)
    climb = CLIMB * of.white * (12 / (points * (points**2 - 1))) ** 0.5 / STEP
    for _ in range(drawn):
        t, oscillation, noise = series(kind, periods, points, generator)
        e = oscillation + noise + of.slope * t
        for found, estimate in ((ours, drift), (lines, metrics.slope)):
            s = estimate(t, e - e[0])
            found.append((s.low <= of.slope <= s.high, (s.high - s.low) / 2))
        if tells and metrics.t_value(t, noise + climb * t) > SURE:
            seen.append(drift(t, e + climb * t).low > 0)
    row = {"kind": kind, "points": points, "periods": periods, "drawn": drawn}
    for suffix, found in (("", ours), (" by the line", lines)):
        row[f"covered{suffix}"] = float(np.mean([hit for hit, _ in found]))
        row[f"half-width{suffix}"] = float(np.median([width for _, width in found]))
    return row | {"seen": float(np.mean(seen)) if seen else float("nan")}


PERIODS_OF = {kind: PERIODS if of.oscillation else (0,) for kind, of in KINDS.items()}
#: All series: keys of cells, of which each period has enough points.
SERIES = [
    {"kind": kind, "periods": periods, "points": points}
    for kind in KINDS
    for points in LENGTHS
    for periods in PERIODS_OF[kind]
    if points >= SAMPLED * periods
]
