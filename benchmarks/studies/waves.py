"""Methods on semi-discretized wave equations: errors of energy and of a quadratic invariant, and the cost."""

from __future__ import annotations

import statistics

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.timing import clock
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import most, picture
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ALONE, ProblemKey
from phasebench.integrators.driver import OK, SKIPPED, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import method as method_of

TABLE = "pde"
METHODS = ("stormer-verlet", "implicit-midpoint", "scheme-iii", "scheme-iv", "scheme-v", "avf", "cohen-hairer-2", "rk4")
#: Label -> method, with its parameters by default.
BY_LABEL = {m.label: m for m in map(method_of, METHODS)}
#: Problem -> (steps h, end time); the largest frequency is 4 / dx^2 (nls), or about 2 / dx (klein-gordon).
RUNS = {"nls:plane-wave": ((0.01, 0.005), 40.0), "nls:soliton": ((0.01,), 20.0), "klein-gordon": ((0.05, 0.025), 100.0)}
#: An error of fewer units of round-off than this counts as round-off.
UNITS = 1000
REPEATS = 3
#: Number of mesh points.
N = 64
RAN = "status == 'ok'"


def measure(problem: str, method: str, h: float) -> dict:
    """Errors of the energy and of the quadratic invariant, evaluations, and seconds of an integration."""
    t_end = RUNS[problem][1]
    made, chosen = problem_of(problem, N=N), BY_LABEL[method]
    system = made.system
    ((invariant, expression),) = made.invariants.items()
    row = {"problem": made.label, "N": N, "d": system.d, "method": chosen.label, "h": h, "t_end": t_end}
    row |= {"invariant": invariant, "energy class": chosen.energy, "quadratic class": chosen.quadratic}
    lack = chosen.lacks(system)
    if lack:
        return row | {"status": SKIPPED, "reason": lack}
    s = integrate(made, chosen, h=h, t_end=t_end)
    row |= {"status": s.status, "reason": s.reason, "fallbacks": s.counts["fallbacks"], "newton": s.counts["newton"]}
    if s.status != OK:
        return row
    # Schemes IV and V change the energy on steps without a root, and restore it later.
    good = (
        np.concatenate([[True], ~np.isnan(s.parameter)]) if chosen.family == "schemes_iv_v" else np.full(len(s.q), True)
    )
    H, value = (system.observe(e, s.q, s.p) for e in (system.H, expression))
    size = system.energy()(s.q[0], s.p[0])[1]
    steps = s.counts["steps"]
    run = prepare(made, chosen)
    return row | {
        "energy error": float(np.abs(H - H[0])[good].max()),
        "energy error, steps without a root": float(np.abs(H - H[0])[~good].max()) if not good.all() else np.nan,
        "energy is kept": bool(np.abs(H - H[0])[good].max() < UNITS * np.finfo(float).eps * size),
        "invariant error": float(np.abs(value - value[0]).max()),
        "invariant is kept": bool(np.abs(value - value[0]).max() < UNITS * np.finfo(float).eps * abs(value[0])),
        "evaluations per step": s.counts["gradient"] / steps,
        "seconds": statistics.median(clock(lambda: run(s.h, steps))() for _ in range(REPEATS)),
    }


@picture(
    TABLE, "waves", "energy error against time",
    "Largest energy error, on steps with a root, over the seconds of the integration; the marks of a curve are its "
    "step sizes.",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure | None:
    ran = frame[frame["status"] == OK]
    if ran.empty:
        return None
    of_method = style.curves("method", "seconds", "energy error", ran["method"].unique(), span=(1e-17, None))
    problems, text = ran.groupby("problem", sort=False), ("warm integration (s)", "energy error")
    return style.row(problems, of_method, 3.2, *text, legend=4, sharey=True)


COLUMNS = {
    "problem": "problem",
    "method": "method",
    "h": "h",
    "energy error": "energy error",
    "invariant": "invariant",
    "invariant error": "its error",
    "evaluations per step": "evaluations a step",
    "fallbacks": "steps without a root",
    "seconds": "seconds",
    "status": "status",
}


@of(TABLE)
def _table(frame: pd.DataFrame) -> Table:
    least = frame.loc[frame.groupby(["problem", "method"], sort=False)["h"].idxmin()]
    caption = "Every method on every problem, at its smallest step."
    return Table(least[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


STUDY = Study(
    id="waves",
    place=310,
    question="Do energy, mass and charge of wave equations stay when many degrees of freedom are integrated?",
    answer="On discretized Schrödinger and Klein–Gordon waves, energy-preserving methods hold the energy in {energy.n} "
    "of {energy.of} runs, except on {missed} steps; {charge.n} of {charge.of} runs declared to keep the charge do.",
    setting=(
        "Nonlinear Schrödinger: i u_t + u_xx + 2|u|²u = 0 (plane wave, soliton), d = 64; Klein–Gordon, d = 128.",
        "Central differences in space leave a Hamiltonian system of d degrees of freedom, which is what is integrated.",
        "Schemes IV and V choose in every step the λ that keeps the energy: a root of an equation, which may have "
        "none.",
        "Charge (Klein–Gordon) is of the form q·Dp. Mass Σ|u|² (Schrödinger) is of the form q·q + p·p: Scheme I keeps "
        "it at λ = 1/2 alone.",
        "Errors are absolute, the largest over all steps; seconds are of the integration without compilation and "
        "output.",
    ),
    runs=(
        Runs(
            TABLE, measure,
            [{"problem": p, "method": m, "h": h} for p in RUNS for m in BY_LABEL for h in RUNS[p][0]],
            needs=lambda problem, method, h: (BY_LABEL[method], ProblemKey(problem, (("N", N),)), RUNS[problem][1]),
            where=ALONE, own=True,
        ),
    ),
    claims={
        "energy": Claim(
            "Methods declared to keep the energy do, to round-off",
            TABLE, "`energy is kept` == True", EVERY, rows=f"{RAN} and `energy class` == '{ROUND_OFF}'", unit="runs",
            where="{method}", names=4, fault=True,
        ),
        "charge": Claim(
            "Methods declared to keep invariants q·Dp keep the charge",
            TABLE, "`invariant is kept` == True", EVERY,
            rows=f"{RAN} and invariant == 'charge' and `quadratic class` == '{ROUND_OFF}'", unit="runs",
            where="{method}", names=4, fault=True,
        ),
        "roots": Claim(
            "Every step of Schemes IV and V has a λ that keeps the energy",
            TABLE, lambda rows: int(rows["fallbacks"].sum()), at_most(0), rows=RAN, unit="steps without",
            where=most("fallbacks", "{method} on {problem}, h = {h:g}"),
        ),
    },
    numbers={"missed": Number(TABLE, "fallbacks", RAN, pd.Series.sum)},
    checks={
        "runs": Claim("Every run that was made came to its end", TABLE, "status == 'ok'", rows="status != 'skipped'"),
    },
    figure=_draw,
    shown=_table,
    whole=of(TABLE)(lambda frame: frame[list(COLUMNS)].rename(columns=COLUMNS)),
    limits=(
        f"An error counts as round-off up to {UNITS} times the unit round-off of the terms of H, or of the invariant.",
        "On steps without a root the energy is missed, and restored in the steps that follow: they are left out of the "
        "energy's error.",
        "What is kept in every cell of space-time is another question: see [local laws](multisymplectic.md).",
    ),
)  # fmt: skip
