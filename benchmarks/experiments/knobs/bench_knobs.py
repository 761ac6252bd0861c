"""Every knob: its runs arrive, and what needs no verdict is as it is known to be."""

from __future__ import annotations

from phasebench.benchmarks.experiments.knobs import arithmetic, ladders, lambdas, nodes, solvers
from phasebench.benchmarks.experiments.knobs.cells import cells  # noqa: F401

#: Scheme III at lambda and at 1 - lambda is the same map with its halves exchanged: it takes about the same iterations.
HALF = 0.5
#: Two that solve the same equations end at errors that differ by less than this share.
ALIKE = 1e-2
#: The least error of every setting is below this: its ladder goes far enough.
REACHED = 1e-2


def short(rows) -> list[str]:
    """The settings whose ladder ends before an error of `REACHED`."""
    least: dict = {}
    for r in rows:
        key = (r["knob"], r["scene"], r["setting"])
        least[key] = min(least.get(key, float("inf")), float("inf") if r["error"] is None else r["error"])
    return [f"{', '.join(key)}: {error:.1e}" for key, error in least.items() if not error <= REACHED]


def bench_lambda(measured):
    """At lambda = 1/2, the implicit midpoint rule, every run arrives."""
    rows = [r for r in measured(lambdas.ERRORS) if r["lam"] == HALF]
    off = [f"{r['method']} on {r['scene']}" for r in rows if not r["trajectory"] < float("inf")]
    assert not off, "\n".join(off)


def bench_largest_steps(measured):
    """At lambda = 1/2 the scenes' own step survives."""
    rows = [r for r in measured(lambdas.COSTS) if r["lam"] == HALF]
    off = [f"{r['method']} on {r['scene']}" for r in rows if not r["largest h"] >= r["h"]]
    assert not off, "\n".join(off)


def bench_ladders(measured):
    """Every setting of every knob gets to `REACHED`."""
    wrong = short(measured(ladders.TABLE))
    assert not wrong, "\n".join(wrong)


def bench_nodes(measured):
    """Every step is solved, whatever the rule."""
    wrong = [f"{r['scene']}, {r['nodes']} nodes" for r in measured(nodes.TABLE) if r["status"] != "ok"]
    assert not wrong, "\n".join(wrong)


def bench_arithmetic(measured):
    """Round-off is told for every arithmetic, and single precision has more of it than double."""
    rows = measured(arithmetic.ERRORS)
    off = {(r["scene"], r["steps"], r["arithmetic"]): r["round-off rms"] for r in rows}
    wrong = [k for k, x in off.items() if k[2] == arithmetic.PLAIN and not x < off[(*k[:2], arithmetic.SINGLE)]]
    assert not wrong, wrong


def bench_costs_of_sums(measured):
    """Both loops took time."""
    assert all(r["ratio"] > 0 for r in measured(arithmetic.COSTS))


def bench_solvers(measured):
    """Newton's method solves every case to round-off, and its end is the engine's."""
    rows = measured(solvers.TABLE)
    own = {(r["scene"], r["h"]): r["error"] for r in rows if r["solver"] == solvers.ENGINE}
    newton = [r for r in rows if r["solver"] == solvers.NEWTON]
    wrong = [r for r in newton if r["status"] != "ok" or not abs(r["error"] / own[r["scene"], r["h"]] - 1) < ALIKE]
    assert not wrong, wrong
