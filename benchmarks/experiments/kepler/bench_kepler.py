"""Kepler with the Schwarzschild term and without, beside the established integrators (`comparison`, `cost`)."""

from __future__ import annotations

from phasebench.benchmarks.experiments.kepler import comparison, cost, times

#: The closed form and the Taylor series may part by this many radians; the best integrator's phase error.
AWAY, BEST = 1e-9, 1e-6


def cells(quick: bool = False):
    """The orbits, what one costs, and error against cost."""
    return [*comparison.cells(quick), *times.cells(quick), *cost.cells(quick)]


def away(rows) -> list[str]:
    """The orbits where the closed form and the Taylor series part: one of them is wrong."""
    return [
        f"{r['problem']}, e = {r['e']}: the closed form and the Taylor series part by {r['phase']:.2e} radians"
        for r in rows
        if r["kind"] == "reference" and not r["phase"] < AWAY
    ]


def nobody(rows, column: str, label: str) -> list[str]:
    """The problems on which the smallest error of a column is not below `BEST`."""
    best: dict[str, float] = {}
    for r in rows:
        error = r.get(column)
        if error is not None and error == error:
            best[label.format(**r)] = min(error, best.get(label.format(**r), float("inf")))
    return [f"{where}: the best {column} is {error:.2e}" for where, error in best.items() if not error < BEST]


def bench_kepler(measured, complete):
    """The closed form is right, and somebody follows every orbit to its end."""
    rows = measured("kepler_growth")
    wrong = away(rows)
    if complete("kepler_growth"):
        ends = [r for r in rows if r["orbits"] == comparison.ORBITS + 0.5 and r["kind"] != "reference"]
        wrong += nobody(ends, "phase", "{problem}, e = {e}")
    assert not wrong, "\n".join(wrong)


def bench_kepler_cost(measured, complete):
    """Some peer comes near the reference: else one of the two is of another problem."""
    rows = [r for r in measured("kepler_cost") if r["kind"] != "phasebench" and r["status"] == "ok"]
    wrong = nobody(rows, "error", "{problem}") if complete("kepler_cost") else []
    assert not wrong, "\n".join(wrong)


def bench_kepler_times(measured):
    """Whoever gets through has a cost."""
    ran = [r for r in measured(times.TABLE) if r["us per orbit"] == r["us per orbit"]]
    wrong = [r for r in ran if not 0 < r["us, low"] <= r["us per orbit"] <= r["us, high"]]
    assert not wrong, wrong
