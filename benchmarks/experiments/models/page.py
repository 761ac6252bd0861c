"""Models: the page."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of
from phasebench.benchmarks.problems.models.ladders import AMPLITUDES, BY_ID, STRONG, WEAK
from phasebench.benchmarks.problems.models.planets import MASSLESS

from . import choice
from .measure import METHODS, MODELS, ROUNDS, RUNS

#: The part of a modelling error that integration may leave open; a saving below this is a loss, no tie.
KNOWN, SAVES = 0.01, 0.9
#: The accuracies that the sentence is about.
ASKED = (1e-2, 1e-4, 1e-6)
COLUMNS = 3


@of(MODELS, RUNS)
def enough(models: pd.DataFrame, runs: pd.DataFrame) -> Verdict:
    """In how many scenes a lower model does, and whether every rung is nearer than the one under it."""
    chosen, rungs = choice.table(models, runs), choice.rungs(models, runs)
    scenes = chosen["scene"].nunique()
    parts = []
    for a in ASKED:
        lower = chosen[(chosen["accuracy"] == a) & ~chosen["full"].astype(bool) & (chosen["model"] != "none")]
        parts.append(f"to {a:.0e} in {lower['scene'].nunique()}")
    said = f"Of {scenes} scenes a lower model is the cheapest {listed(parts)}"
    never = [
        s for s, mine in rungs.groupby("scene", sort=False) if mine["modelling error"].min() > choice.ACCURACIES[0]
    ]
    further = [f"{r['model']} ({r['scene']})" for _, r in rungs[~rungs["nearer"].astype(bool)].iterrows()]
    text = said
    text += f"; none has {choice.ACCURACIES[0]:.0e} in {listed(never, 4)}" if never else ""
    text += (
        f"; no nearer than the model under it: {listed(further, 4)}"
        if further
        else "; each is nearer than the one under it"
    )
    return Verdict(f"{text}.", not further, f"{said}.")


@of(MODELS, RUNS)
def saved(models: pd.DataFrame, runs: pd.DataFrame) -> Verdict | None:
    """What a lower model saves at its own accuracy, and what an integration beyond it costs."""
    rungs = choice.rungs(models, runs)
    known = rungs[np.isfinite(rungs["gain"].astype(float))]
    if known.empty:
        return None
    best, dear = known.loc[known["gain"].idxmax()], known[known["gain"] < SAVES]
    said = f"At its own accuracy a lower model is no dearer than the full one in {len(known) - len(dear)} of {len(known)} cases"
    text = f"{said}, at most {number(best['gain'])} times ({_name(best)})"
    text += f"; dearer: {listed([_name(r) for _, r in dear.iterrows()], 4)}" if len(dear) else ""
    wasted = rungs[rungs["wasted"].notna()]
    if len(wasted):
        worst = wasted.loc[wasted["wasted"].idxmax()]
        text += (
            f"; integrated to {choice.FINE:.0e} it takes {number(wasted['wasted'].median())} times as long in the "
            f"median for digits that the model has not, at most {number(worst['wasted'])} ({_name(worst)})"
        )
    return Verdict(f"{text}.", dear.empty, f"{said}.")


def _name(row) -> str:
    return f"{row['model']}, {row['scene']}"


@of(MODELS, RUNS)
def known(models: pd.DataFrame, runs: pd.DataFrame) -> Verdict | None:
    """Whether the modelling errors are the models' own."""
    rungs = choice.rungs(models, runs)
    if rungs.empty:
        return None
    vague = rungs[~(rungs["known to"] <= KNOWN)]
    worst = rungs.loc[rungs["known to"].idxmax()]
    full = models[models["full"].astype(bool)]
    said = f"{len(rungs) - len(vague)} of {len(rungs)} modelling errors are known to a part {number(KNOWN)}"
    text = f"{said} (the least known, {_name(worst)}, to {number(float(worst['known to']), 2)})"
    text += f"; not: {listed([_name(r) for _, r in vague.iterrows()], 4)}" if len(vague) else ""
    text += (
        f"; the full models' own integrations end within {number(full['integration'].max(), 2)} of what is true"
        if len(full)
        else ""
    )
    return Verdict(f"{text}.", vague.empty, f"{said}.")


def envelope(runs: pd.DataFrame, modelling: float) -> tuple[np.ndarray, np.ndarray]:
    """(seconds, errors against the full model) of the runs that nothing cheaper beats, by seconds."""
    ordered = runs.sort_values("seconds")
    errors = np.minimum.accumulate(ordered["error"].to_numpy(float))
    keep = np.diff(errors, prepend=np.inf) < 0
    return ordered["seconds"].to_numpy(float)[keep], (errors + modelling)[keep]


@of(MODELS, RUNS)
def draw(models: pd.DataFrame, runs: pd.DataFrame, folder) -> list[Picture]:
    """Errors against the full model over seconds, a panel a scene: where a curve is level, digits are wasted."""
    scenes = list(choice.scenes(models, runs))
    rows = -(-len(scenes) // COLUMNS)
    with style.settings():
        figure, panels = style.panels(rows, COLUMNS, 2.1 * rows)
        for axes, (scene, mine, part) in zip(panels.flat, scenes, strict=False):
            for look, (m, own) in zip(style.looks(), choice.of_scene(mine, part), strict=False):
                label = f"{m['rung'] + 1}" + (": full" if m["full"] else "")
                axes.loglog(*envelope(own, m["modelling error"]), label=label, **look)
            axes.set(title=scene)
            axes.legend(handlelength=2.0, fontsize=6)
            axes.grid(color="0.93", linewidth=0.5)
        for axes in panels.flat[len(scenes) :]:
            axes.set_axis_off()
        for axes in panels[:, 0]:
            axes.set_ylabel("error")
        for axes in panels[-1]:
            axes.set_xlabel("seconds")
    caption = (
        "Modelling and integration error together against seconds, the cheapest runs of each model, numbered from the "
        "least one as in the table: where a curve is level, an integrator's digits are wasted below its model's."
    )
    return [Picture(style.save(figure, folder, "models.png"), "models of each scene", caption)]


@of(MODELS, RUNS)
def table(models: pd.DataFrame, runs: pd.DataFrame) -> Table:
    """The cheapest sufficient model of each scene at each accuracy."""
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
        "The cheapest model of each scene whose modelling and integration errors together meet an accuracy, by its number, "
        "and how many times the full model's time at that accuracy it saves; none: doubles or the steps tried end before."
    )
    return Table(pd.DataFrame(out).head(ROWS), caption)


@of(MODELS, RUNS)
def whole(models: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """Every lower model."""
    return choice.rungs(models, runs)


def _spans(*ids: str) -> str:
    return "; ".join(f"{id}: {BY_ID[id].quantity} at t = {BY_ID[id].t_end:g}" for id in ids)


PAGE = Page(
    id="models",
    question="Which model of a scene suffices, at which accuracy?",
    tables=(MODELS, RUNS),
    setting=(
        "Each scene has a ladder of models from the least to the full; a model's solution is mapped to the full problem's state, "
        "and its error is that of the scene's quantity.",
        f"Pendulum from rest at {listed([f'{a:g}' for a in AMPLITUDES])}: {BY_ID['pendulum-2'].quantity} at t = "
        f"{BY_ID['pendulum-2'].t_end:g}; Kepler with -mu / (3 r^3), (e, mu) = {STRONG}, weak {WEAK}: "
        f"{_spans('kepler-strong', 'kepler-strong-perihelion', 'kepler-weak-perihelion')}.",
        f"The outer planets, in days: {_spans('jupiter-14-years', 'jupiter-1400-years', 'saturn-140-years')}.",
        f"Stiff springs and waves: {_spans('fpu-soft-chain', 'klein-gordon-linear', 'klein-gordon-points')}.",
        f"Integrated with {listed(METHODS)}, steps doubled from coarse ones; seconds are warm, in turns, the cheapest of the three.",
    ),
    verdicts=(enough, saved, known),
    figures=draw,
    table=table,
    whole=whole,
    limits=(
        "A modelling error is of one orbit, one span and one quantity: it grows with time as the orbits part.",
        "What is called full is the suite's own problem: the lattice is not the wave equation, the six bodies are not the sky.",
        "Closed forms (Kepler's and the oscillator's solution) would be cheaper still; here every model is integrated.",
        f"A body without mass has {MASSLESS:g} of the Sun's. Savings below {SAVES:g} times and parts above {KNOWN:g} make findings.",
        f"Times are the machine's own, medians of {ROUNDS} rounds; steps are powers of two apart, and gains no finer than that.",
    ),
    command="pytest benchmarks/experiments/models",
)
