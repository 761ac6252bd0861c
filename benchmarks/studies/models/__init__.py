"""Which simplified model of a physical system suffices at which accuracy, and the time that it saves."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import EVERY, at_least, at_most
from phasebench.benchmarks.problems.models import ladders
from phasebench.benchmarks.problems.models.ladders import AMPLITUDES, BY_ID, LADDERS, STRONG, WEAK
from phasebench.benchmarks.problems.models.planets import MASSLESS
from phasebench.benchmarks.store.cells import ALONE

from . import choice
from .measure import METHODS, MODELS, ROUNDS, RUNS, models_of, needs

#: Largest uncertainty of a modelling error, as a share of it; smallest speed-up of a simpler model that is no loss.
KNOWN, SAVES = 0.01, 0.9
#: The accuracies named in the answer.
ASKED = (1e-2, 1e-6)
COLUMNS = 3


def nearer(models: pd.DataFrame, runs: pd.DataFrame) -> pd.Series:
    """True for a model that is nearer to the full one than the simpler model before it."""
    return choice.column("nearer")(models, runs).astype(bool)


@of(MODELS, RUNS)
def _answer(models: pd.DataFrame, runs: pd.DataFrame) -> str:
    chosen = choice.table(models, runs)
    lower = chosen[~chosen["full"].astype(bool) & (chosen["model"] != "none")]
    wide, fine = (lower[lower["accuracy"] == a]["scene"].nunique() for a in ASKED)
    text = f"To an error of {ASKED[0]:.0e} a simpler model is fastest in {wide} of {chosen['scene'].nunique()} scenes, "
    text += f"to {ASKED[1]:.0e} in {fine}"
    gain = lower["gain"].max()
    return f"{text}, up to {number(gain, 2)} times as fast as the full one." if np.isfinite(gain) else f"{text}."


def envelope(runs: pd.DataFrame, modelling: float) -> tuple[np.ndarray, np.ndarray]:
    """(Seconds, errors against the full problem) of the runs of a model that no faster run beats, sorted by time."""
    ordered = runs.sort_values("seconds")
    errors = np.minimum.accumulate(ordered["error"].to_numpy(float))
    keep = np.diff(errors, prepend=np.inf) < 0
    return ordered["seconds"].to_numpy(float)[keep], (errors + modelling)[keep]


@picture(
    (MODELS, RUNS), "models", "models of each scene",
    "Sum of modelling and integration error over the time of a run, for the fastest runs of each model, numbered "
    "as in the table; a panel's last one is the full model. Where a curve is level, a more accurate integration "
    "gains nothing.",
)  # fmt: skip
def _draw(models: pd.DataFrame, runs: pd.DataFrame) -> style.Figure:
    scenes = list(choice.scenes(models, runs))
    rows = -(-len(scenes) // COLUMNS)
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
    return figure


@of(MODELS, RUNS)
def _table(models: pd.DataFrame, runs: pd.DataFrame) -> Table:
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
        "The fastest model of each scene whose modelling and integration errors together meet an accuracy, by its "
        "number, and in brackets how many times as fast as the full model it is; full: the full model; none: no step "
        "tried in double precision gets there."
    )
    return Table(pd.DataFrame(out).head(ROWS), caption)


def _spans(*ids: str) -> str:
    return "; ".join(f"{id}: {BY_ID[id].quantity} at t = {BY_ID[id].t_end:g}" for id in ids)


STUDY = Study(
    id="models",
    place=50,
    question="Which model of a scene suffices, at which accuracy?",
    answer=_answer,
    setting=(
        "Each scene has several models, from the simplest to the full one. A model's solution is mapped to the full "
        "problem's state; its error is that of one quantity of the scene.",
        f"Pendulum from rest at {join_list([f'{a:g}' for a in AMPLITUDES])}: {BY_ID['pendulum-2'].quantity} at t = "
        f"{BY_ID['pendulum-2'].t_end:g}; Kepler with the term −μ/(3 r³), (e, μ) = {STRONG}, or weaker {WEAK}: "
        f"{_spans('kepler-strong', 'kepler-strong-perihelion', 'kepler-weak-perihelion')}.",
        f"The outer planets, in days: {_spans('jupiter-14-years', 'jupiter-1400-years', 'saturn-140-years')}.",
        f"Stiff springs and waves: {_spans('fpu-soft-chain', 'klein-gordon-linear', 'klein-gordon-points')}.",
        f"Each is integrated with {join_list(METHODS)} at ever smaller steps, timed without compilation and in turns; "
        "the fastest of the three counts.",
    ),
    runs=(
        Runs(MODELS, models_of, over(scene=[x.id for x in LADDERS]), needs=needs, where=ALONE, own=True,
             quick=({"scene": LADDERS[0].id},), more=(RUNS,), code=(ladders.__name__,)),
    ),
    claims={
        "nearer": Claim(
            "Each model is nearer to the full one than the simpler model before it",
            MODELS, nearer, EVERY, beside=(RUNS,), unit="models", names=3,
        ),
        "savings": Claim(
            "At its own accuracy a simpler model is no slower than the full one",
            MODELS, choice.column("gain", most=1e300), at_least(SAVES), beside=(RUNS,), unit="times as fast", span=True,
        ),
        "share": Claim(
            "Integration errors are a small part of every modelling error",
            MODELS, choice.column("known to"), at_most(KNOWN), beside=(RUNS,), unit="of the modelling error",
            fault=True,
        ),
    },
    checks={"full": Claim("Full models end at what is true", MODELS, "integration", at_most(1e-9), rows="full")},
    figure=_draw,
    shown=_table,
    whole=of(MODELS, RUNS)(choice.rungs),
    limits=(
        "A modelling error is of one orbit, one time span and one quantity; it grows with time as the orbits separate.",
        "The full model is this suite's problem: a lattice, not the wave equation; six bodies, not the solar system.",
        "Closed forms (Kepler's and the oscillator's solution) would be faster still; here every model is integrated.",
        f"A body without mass has {MASSLESS:g} of the Sun's. A simpler model may take {1 / SAVES - 1:.0%} longer and "
        "count as no slower. Beyond an error of 1 two models count as equally far.",
        f"Times are this machine's, medians of {ROUNDS} rounds; steps are powers of two apart, and the gains "
        "no finer than that.",
    ),
)  # fmt: skip
