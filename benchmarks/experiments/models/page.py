"""The report page on simplified models of a physical system: which suffices at an accuracy, and the time it saves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Range, Verdict, at_least, at_most
from phasebench.benchmarks.problems.models.ladders import AMPLITUDES, BY_ID, STRONG, WEAK
from phasebench.benchmarks.problems.models.planets import MASSLESS

from . import choice
from .measure import METHODS, MODELS, ROUNDS, RUNS

if TYPE_CHECKING:
    from pathlib import Path

#: Largest uncertainty of a modelling error, as a share of it; smallest speed-up of a simpler model that is no loss.
KNOWN, SAVES = 0.01, 0.9
#: The accuracies named in the answer.
ASKED = (1e-2, 1e-6)
COLUMNS = 3


@of(MODELS, RUNS)
def nearer(models: pd.DataFrame, runs: pd.DataFrame) -> Verdict | None:
    """Judge whether each model has a smaller modelling error than the next simpler model of the same scene.

    ``models`` and ``runs`` are the tables of models and of timed runs; None if there is no simplified model.
    """
    rungs = choice.rungs(models, runs)
    if rungs.empty:
        return None
    further = rungs[~rungs["nearer"].astype(bool)]
    return Verdict(
        "Each model is nearer to the full one than the simpler model before it",
        Count(len(rungs) - len(further), len(rungs)),
        EVERY,
        "models",
        where=join_list([_name(r) for _, r in further.iterrows()], 3) if len(further) else "",
    )


@of(MODELS, RUNS)
def savings(models: pd.DataFrame, runs: pd.DataFrame) -> Verdict | None:
    """Judge whether a simpler model takes no longer than the full one at an error as large as its modelling error.

    ``models`` and ``runs`` are the tables of models and of timed runs; None if no two such times are known.
    """
    rungs = choice.rungs(models, runs)
    known = rungs[np.isfinite(rungs["gain"].astype(float))]
    if known.empty:
        return None
    return Verdict(
        "At its own accuracy a simpler model is no slower than the full one",
        Range(known["gain"].min(), known["gain"].max()),
        at_least(SAVES),
        "times as fast",
        where=_name(known.loc[known["gain"].idxmin()]),
    )


def _name(row: pd.Series) -> str:
    return f"{row['model']} ({row['scene']})"


@of(MODELS, RUNS)
def integration_share(models: pd.DataFrame, runs: pd.DataFrame) -> Verdict | None:
    """Judge whether integration errors are at most the share `KNOWN` of the modelling errors.

    ``models`` and ``runs`` are the tables of models and of timed runs; None if there is no simplified model.
    """
    rungs = choice.rungs(models, runs)
    if rungs.empty:
        return None
    worst = rungs.loc[rungs["known to"].idxmax()]
    return Verdict(
        "Integration errors are a small part of every modelling error",
        float(worst["known to"]),
        at_most(KNOWN),
        "of the modelling error",
        where=_name(worst),
        otherwise=FAIL,
    )


@of(MODELS, RUNS)
def answer(models: pd.DataFrame, runs: pd.DataFrame) -> str:
    """Write the page's answer, a sentence: in how many scenes a simpler model is the fastest, and the largest gain.

    A scene is a physical system with a time span and a quantity.  ``models`` and ``runs`` are the tables of models
    and of timed runs.
    """
    chosen = choice.table(models, runs)
    lower = chosen[~chosen["full"].astype(bool) & (chosen["model"] != "none")]
    wide, fine = (lower[lower["accuracy"] == a]["scene"].nunique() for a in ASKED)
    text = f"To an error of {ASKED[0]:.0e} a simpler model is fastest in {wide} of {chosen['scene'].nunique()} scenes, "
    text += f"to {ASKED[1]:.0e} in {fine}"
    gain = lower["gain"].max()
    return f"{text}, up to {number(gain, 2)} times as fast as the full one." if np.isfinite(gain) else f"{text}."


def envelope(runs: pd.DataFrame, modelling: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (seconds, errors against the full problem) of those runs of a model that no faster run beats.

    The errors are those of the integration plus ``modelling``, the model's modelling error; both are arrays, sorted by
    time.
    """
    ordered = runs.sort_values("seconds")
    errors = np.minimum.accumulate(ordered["error"].to_numpy(float))
    keep = np.diff(errors, prepend=np.inf) < 0
    return ordered["seconds"].to_numpy(float)[keep], (errors + modelling)[keep]


@of(MODELS, RUNS)
def draw(models: pd.DataFrame, runs: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the error against the full model over seconds: a panel for each scene, a curve for each model.

    A curve that becomes level shows that finer steps are needless.  ``models`` and ``runs`` are the tables of models
    and of timed runs; the figure is saved in ``folder``.
    """
    scenes = list(choice.scenes(models, runs))
    rows = -(-len(scenes) // COLUMNS)
    with style.settings():
        figure, panels = style.panels(rows, COLUMNS, 2.1 * rows)
        for axes, (scene, mine, part) in zip(panels.flat, scenes, strict=False):
            for look, (m, own) in zip(style.looks(), choice.of_scene(mine, part), strict=False):
                axes.loglog(*envelope(own, m["modelling error"]), label=f"model {m['rung'] + 1}", **look)
            axes.set(title=scene)
            axes.grid(color="0.93", linewidth=0.5)
        for axes in panels.flat[len(scenes) :]:
            axes.set_axis_off()
        for axes in panels[:, 0]:
            axes.set_ylabel("error")
        for axes in panels[-1]:
            axes.set_xlabel("seconds")
        style.legend_above(figure, max(panels.flat, key=lambda axes: len(axes.get_lines())), 6)
    caption = (
        "Sum of modelling and integration error over the time of a run, for the fastest runs of each model, numbered as in "
        "the table; a panel's last one is the full model. Where a curve is level, a more accurate integration gains nothing."
    )
    return [Picture(style.save(figure, folder, "models.png"), "models of each scene", caption)]


@of(MODELS, RUNS)
def table(models: pd.DataFrame, runs: pd.DataFrame) -> Table:
    """Make the page's table: a row for each scene, with the fastest model that suffices at each accuracy.

    A scene is a physical system with a time span and a quantity.  ``models`` and ``runs`` are the tables of models
    and of timed runs.
    """
    chosen = choice.table(models, runs)
    out = []
    for scene, mine in chosen.groupby("scene", sort=False):
        names = models[models["scene"] == scene].sort_values("rung")
        row = {"scene": scene, "models": "; ".join(f"{r['rung'] + 1} {r['model']}" for _, r in names.iterrows())}
        numbers = dict(zip(names["model"], names["rung"] + 1, strict=True))
        for r in mine.itertuples():
            gain = "" if r.full or r.gain != r.gain else f" ({number(r.gain, 2)})"
            row[f"{r.accuracy:.0e}"] = "full" if r.full else f"{numbers.get(r.model, 'none')}{gain}"
        out.append(row)
    caption = (
        "The fastest model of each scene whose modelling and integration errors together meet an accuracy, by its number, "
        "and in brackets how many times as fast as the full model it is; full: the full model; none: no step tried in double precision "
        "gets there."
    )
    return Table(pd.DataFrame(out).head(ROWS), caption)


@of(MODELS, RUNS)
def full_table(models: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """Make the page's longer table, a row for each simplified model (see `choice.rungs`).

    It has the modelling error, the time that the model saves, and the time that needlessly fine steps waste.
    ``models`` and ``runs`` are the tables of models and of timed runs.
    """
    return choice.rungs(models, runs)


def _spans(*ids: str) -> str:
    return "; ".join(f"{id}: {BY_ID[id].quantity} at t = {BY_ID[id].t_end:g}" for id in ids)


PAGE = Page(
    id="models",
    question="Which model of a scene suffices, at which accuracy?",
    tables=(MODELS, RUNS),
    setting=(
        "Each scene has several models, from the simplest to the full one. A model's solution is mapped to the full problem's "
        "state; its error is that of one quantity of the scene.",
        f"Pendulum from rest at {join_list([f'{a:g}' for a in AMPLITUDES])}: {BY_ID['pendulum-2'].quantity} at t = "
        f"{BY_ID['pendulum-2'].t_end:g}; Kepler with the term −μ/(3 r³), (e, μ) = {STRONG}, or weaker {WEAK}: "
        f"{_spans('kepler-strong', 'kepler-strong-perihelion', 'kepler-weak-perihelion')}.",
        f"The outer planets, in days: {_spans('jupiter-14-years', 'jupiter-1400-years', 'saturn-140-years')}.",
        f"Stiff springs and waves: {_spans('fpu-soft-chain', 'klein-gordon-linear', 'klein-gordon-points')}.",
        f"Each is integrated with {join_list(METHODS)} at ever smaller steps, timed without compilation and in turns; the fastest "
        "of the three counts.",
    ),
    verdicts=(nearer, savings, integration_share),
    answer=answer,
    figures=draw,
    table=table,
    whole=full_table,
    limits=(
        "A modelling error is of one orbit, one time span and one quantity; it grows with time as the orbits separate.",
        "The full model is this suite's problem: a lattice, not the wave equation; six bodies, not the solar system.",
        "Closed forms (Kepler's and the oscillator's solution) would be faster still; here every model is integrated.",
        f"A body without mass has {MASSLESS:g} of the Sun's. A simpler model may take {1 / SAVES - 1:.0%} longer and count as no slower. "
        "Beyond an error of 1 two models count as equally far.",
        f"Times are this machine's, medians of {ROUNDS} rounds; steps are powers of two apart, and the gains no finer than that.",
    ),
    command="pytest benchmarks/experiments/models",
)
