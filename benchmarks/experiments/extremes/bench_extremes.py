"""Where every method breaks: known limits are met, long runs agree, adaptive peers hold hard eccentricities."""

from __future__ import annotations

from phasebench.benchmarks.experiments.extremes import brouwer
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.experiments.extremes.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.extremes.round_off_verdicts import ABOVE, ENERGY

#: Scheme I's limits are in closed form to this.
SHARP = 1e-10
#: Peers that adapt their steps, or solve Kepler's problem exactly, hold the error at this eccentricity at least.
HARD = 0.999


def unlike(rows) -> list[str]:
    """The known limits that are not met."""
    return [
        f"{r['method']} {r['parameters']}: {r['measured']}, known {r['known limit']}" for r in rows if not r["agrees"]
    ]


def unconfirmed(rows) -> list[str]:
    """The methods of which a long run does not end as the trace of a step says."""
    return [
        f"{r['label']}: {r['confirmed']} of {r['runs']}" for r in rows if r.get("runs") and r["confirmed"] < r["runs"]
    ]


def bench_known_limits(measured):
    """Every limit that others print, or that is known in closed form, is met to its digits."""
    wrong = unlike(measured("extremes_published"))
    assert not wrong, "\n".join(wrong)


def bench_closed_form(measured):
    """Scheme I's limit is 2 / |1 - 2 lambda| to ten digits."""
    rows = measured("extremes_scheme_i")
    off = [
        r["lam"] for r in rows if r["limit"] != r["closed form"] and not abs(r["limit"] / r["closed form"] - 1) < SHARP
    ]
    assert not off, off


def bench_long_runs(measured):
    """Long runs beside the limits, within later intervals and gaps, stay or grow as the step map says."""
    wrong = unconfirmed(measured("extremes_linear"))
    assert not wrong, "\n".join(wrong)


def bench_encounters(measured):
    """Peers that adapt their step hold an eccentricity of `HARD`."""
    adaptive = [r for r in measured("extremes_encounters") if r["kind"] == "adaptive" and r["e"] <= HARD]
    lost = [f"{r['method']}, e = {r['e']}: {r['error']:.1e}" for r in adaptive if not r["held"]]
    assert not lost, "\n".join(lost)


def bench_small_denominators(measured):
    """Beside the fractions at which round-off drifts, and with the whole state in the force, it does not."""
    rows = measured("extremes_growth")
    free = [r for r in rows if r["kind"] == brouwer.ASIDE_OF or r["label"] == controls.WHOLE]
    drifting = [f"{r['label']}, h = {r['h']!r}" for r in free if r["energy low"] > ENERGY + ABOVE]
    assert free or not rows
    assert not drifting, "\n".join(drifting)
