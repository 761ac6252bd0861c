"""Choose, from the measured tables, the model of a physical system that suffices at an accuracy, and the time it saves.

A model is the full problem or a simplification of it; a scene is a full problem with a time span and a quantity, and
has several models.  In the tables the column ``rung`` numbers a scene's models from the simplest to the full one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf, nan

import numpy as np
import pandas as pd

#: Accuracies at which a model is chosen.
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
#: The accuracy of a needlessly fine integration, to which the column ``wasted`` of `rungs` refers.
FINE = 1e-10
#: Models with errors above this (a radian, the size of the state) count as equally wrong.
LOST = 1.0
RUNGS = ("scene", "model", "d", "modelling error", "known to", "nearer", "seconds", "full, seconds", "gain", "wasted")


def cost(runs: pd.DataFrame, accuracy: float) -> float:
    """Return the seconds of a model's fastest run with an integration error of at most ``accuracy``, or infinity."""
    good = runs[runs["error"] <= accuracy]
    return float(good["seconds"].min()) if len(good) else inf


def of_scene(models: pd.DataFrame, runs: pd.DataFrame) -> list[tuple[pd.Series, pd.DataFrame]]:
    """Pair each model of one scene with its runs, from the simplest to the full model.

    ``models`` and ``runs`` are the scene's rows of the two tables; a pair is (row of the model, DataFrame of its runs).
    """
    return [(m, runs[runs["rung"] == m["rung"]]) for _, m in models.sort_values("rung").iterrows()]


def at(models: pd.DataFrame, runs: pd.DataFrame, accuracy: float) -> tuple[str, float, bool]:
    """Return (name, gain, whether it is the full one) of the fastest model of a scene that meets an accuracy.

    ``models`` and ``runs`` are the scene's rows of the two tables, of models and of timed runs.  A model meets the
    accuracy if its modelling and integration errors add up to at most ``accuracy``; ``gain`` is the full model's time
    over this one's.  ("none", NaN, False) if no model meets it.
    """
    found = [(cost(own, accuracy - m["modelling error"]), m) for m, own in of_scene(models, runs)]
    best = min(range(len(found)), key=lambda i: found[i][0])
    seconds, model = found[best]
    if seconds == inf:
        return "none", nan, False
    return model["model"], found[-1][0] / seconds, bool(model["full"])


def table(models: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """Choose the fastest model that suffices: a row for each scene and accuracy, with its gain over the full model.

    The accuracies are `ACCURACIES`; the columns are scene, accuracy, model, gain and full (see `at`).
    ``models`` and ``runs`` are the tables of models and of timed runs.
    """
    return pd.DataFrame(
        [
            dict(zip(("scene", "accuracy", "model", "gain", "full"), (scene, a, *at(mine, part, a)), strict=True))
            for scene, mine, part in scenes(models, runs)
            for a in ACCURACIES
        ]
    )


def scenes(models: pd.DataFrame, runs: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    """Yield (scene, its rows of ``models``, its rows of ``runs``) for each scene of the two tables.

    A scene is a physical system with a time span and a quantity.
    """
    for scene, mine in models.groupby("scene", sort=False):
        yield scene, mine, runs[runs["scene"] == scene]


def rungs(models: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """Judge the simplified models: a row for each, with its modelling error and the time that it saves.

    ``models`` and ``runs`` are the tables of models and of timed runs.  Columns, among others:

    - "gain" : the full model's time to an error of twice this model's modelling error, over this model's time to an
      integration error as large as its modelling error
    - "full, seconds", "seconds" : these two times
    - "known to" : the uncertainty of the modelling error, as a share of it
    - "nearer" : whether the modelling error is below that of the next simpler model, or both are larger than `LOST`
    - "wasted" : the time of this model's integration to `FINE` over that of one to its modelling error;
      NaN if the modelling error is not larger than `FINE`
    """
    out = []
    for scene, mine, part in scenes(models, runs):
        *lower, (_, full) = of_scene(mine, part)
        before = inf
        for m, own in lower:
            error = float(m["modelling error"])
            enough, least = cost(own, error), cost(full, 2 * error)
            fine = cost(own, FINE)
            out.append(
                {
                    "scene": scene,
                    "model": m["model"],
                    "d": m["d"],
                    "modelling error": error,
                    "known to": (m["integration"] + m["uncertainty"]) / error if error else inf,
                    "nearer": error < before or min(error, before) > LOST,
                    "seconds": enough,
                    "full, seconds": least,
                    "gain": least / enough if np.isfinite(enough) else nan,
                    "wasted": fine / enough if error > FINE and np.isfinite(fine) else nan,
                }
            )
            before = error
    return pd.DataFrame(out, columns=RUNGS)


def column(name: str, most: float = inf) -> Callable[[pd.DataFrame, pd.DataFrame], pd.Series]:
    """A column of `rungs` by "model (scene)", where it is a number of at most ``most``."""

    def of(models: pd.DataFrame, runs: pd.DataFrame) -> pd.Series:
        found = rungs(models, runs)
        values = found[name].set_axis([f"{r['model']} ({r['scene']})" for _, r in found.iterrows()])
        return values[values.astype(float) <= most]

    return of
