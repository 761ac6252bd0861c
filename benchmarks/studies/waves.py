"""Methods on semi-discretized wave equations: errors of energy and of a quadratic invariant, and the cost."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY, Count, at_most
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
        "seconds": statistics.median(_seconds(lambda: run(s.h, steps)) for _ in range(REPEATS)),
    }


def _seconds(run: Callable[[], object]) -> float:
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


# -- judging -----------------------------------------------------------------------------------------------------------


def kept(what: str) -> Callable[[pd.DataFrame], Count]:
    """The runs that keep the "energy" or the "invariant", of completed ones whose method is declared to."""

    def count(rows: pd.DataFrame) -> Count:
        part = declared(rows, what)
        return Count(int(part[f"{what} is kept"].astype(bool).sum()), len(part))

    return count


def lost(what: str) -> Callable[[pd.DataFrame], str]:
    """The methods that do not keep it, though they are declared to."""

    def names(rows: pd.DataFrame) -> str:
        part = declared(rows, what)
        off = sorted(part.loc[~part[f"{what} is kept"].astype(bool), "method"].unique())
        return join_list(off, 4) if off else ""

    return names


def declared(rows: pd.DataFrame, what: str) -> pd.DataFrame:
    """The completed runs whose method is declared to keep the "energy", or the charge (as "invariant")."""
    ran = rows[rows["status"] == OK]
    if what == "energy":
        return ran[ran["energy class"] == ROUND_OFF]
    return ran[(ran["invariant"] == "charge") & (ran["quadratic class"] == ROUND_OFF)]


def rootless(rows: pd.DataFrame) -> str:
    """The run with most steps without a root."""
    row = rows.loc[rows["fallbacks"].idxmax()]
    return f"{row['method']} on {row['problem']}, h = {number(row['h'])}" if row["fallbacks"] else ""


@of(TABLE)
def answer(frame: pd.DataFrame) -> str | None:
    """How many runs that are declared to keep the energy, and the charge, do."""
    energies, charges = kept("energy")(frame), kept("invariant")(frame)
    if not energies.of:
        return None
    text = "On discretized Schrödinger and Klein–Gordon waves, energy-preserving methods hold the energy"
    text += f" in {energies.n} of {energies.of} runs"
    missed = int(frame.loc[frame["status"] == OK, "fallbacks"].sum())
    text += f", except on {missed} steps" if missed else ""
    return f"{text}; {charges.n} of {charges.of} runs declared to keep the charge do." if charges.of else f"{text}."


# -- what is shown -----------------------------------------------------------------------------------------------------


@of(TABLE)
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture] | None:
    """The energy error against the time of an integration, a panel for each wave equation."""
    ran = frame[frame["status"] == OK]
    if ran.empty:
        return None
    problems, methods = (list(dict.fromkeys(ran[c])) for c in ("problem", "method"))
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.2, sharey=True)
        for axes, name in zip(panels, problems, strict=True):
            for k, method in enumerate(methods):
                part = ran[(ran["problem"] == name) & (ran["method"] == method)]
                axes.loglog(part["seconds"], part["energy error"].clip(lower=1e-17), label=method, **style.curve(k))
            axes.set(title=name, xlabel="warm integration (s)")
            axes.grid(color="0.93", linewidth=0.5)
        panels[0].set_ylabel("energy error")
        style.legend_above(figure, panels[0], 4)
    caption = (
        "Largest energy error, on steps with a root, over the seconds of the integration; the marks of a curve are its "
        "step sizes."
    )
    return [Picture(style.save(figure, folder, "waves.png"), "energy error against time", caption)]


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
def table(frame: pd.DataFrame) -> Table:
    """Every method on every equation, at its smallest step."""
    least = frame.loc[frame.groupby(["problem", "method"], sort=False)["h"].idxmin()]
    caption = "Every method on every problem, at its smallest step."
    return Table(least[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@of(TABLE)
def whole(frame: pd.DataFrame) -> pd.DataFrame:
    """All runs."""
    return frame[list(COLUMNS)].rename(columns=COLUMNS)


STUDY = Study(
    id="waves",
    place=310,
    question="Do energy, mass and charge of wave equations stay when many degrees of freedom are integrated?",
    answer=answer,
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
            TABLE, kept("energy"), EVERY, unit="runs", where=lost("energy"), fault=True,
        ),
        "charge": Claim(
            "Methods declared to keep invariants q·Dp keep the charge",
            TABLE, kept("invariant"), EVERY, unit="runs", where=lost("invariant"), fault=True,
        ),
        "roots": Claim(
            "Every step of Schemes IV and V has a λ that keeps the energy",
            TABLE, lambda rows: int(rows["fallbacks"].sum()), at_most(0), rows="status == 'ok'", unit="steps without",
            where=rootless,
        ),
    },
    checks={
        "runs": Claim("Every run that was made came to its end", TABLE, "status == 'ok'", rows="status != 'skipped'"),
    },
    figure=draw,
    shown=table,
    whole=whole,
    limits=(
        f"An error counts as round-off up to {UNITS} times the unit round-off of the terms of H, or of the invariant.",
        "On steps without a root the energy is missed, and restored in the steps that follow: they are left out of the "
        "energy's error.",
        "What is kept in every cell of space-time is another question: see [local laws](multisymplectic.md).",
    ),
)  # fmt: skip
