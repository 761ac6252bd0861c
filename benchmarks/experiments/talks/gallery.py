"""FIGURES: every figure of the report, one record each; each integrates what it shows and computes its caption.

The figures are those of the two talks: pendulum and symplectic maps, Lotka-Volterra, Henon-Heiles, perturbed Kepler,
convergence.  A new figure is a function ``draw(quick) -> (figure, caption)`` and one more record.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path

from phasebench.benchmarks.page import style
from phasebench.integrators.errors import unknown

from . import convergence, henon_heiles, linear_map, lotka_volterra, pendulum, perturbed_kepler
from .record import Figure

FIGURES: tuple[Figure, ...] = (
    *pendulum.FIGURES,
    *linear_map.FIGURES,
    *lotka_volterra.FIGURES,
    *henon_heiles.FIGURES,
    *perturbed_kepler.FIGURES,
    *convergence.FIGURES,
)

#: The list of the figures in a folder: id -> file name and caption.
CAPTIONS = "captions.json"


def save(
    directory: str | Path,
    quick: bool = False,
    only: Iterable[str] | None = None,
    progress: Callable[[int, int, Figure], None] | None = None,
) -> list[tuple[Figure, str, str]]:
    """Draw the figures into ``directory``, made where it is not there.

    Parameters
    ----------
    directory : where the PNG files go
    quick : shorter integrations and fewer points
    only : ids of the figures wanted, all where None
    progress : called with (figures done, figures wanted, the figure just done)

    Returns
    -------
    list of (figure, file name, caption), in the order of `FIGURES`

    Raises
    ------
    InvalidInput
        For an unknown id, naming the nearest.
    """
    ids = [f.id for f in FIGURES]
    wanted = set(ids if only is None else only)
    for id in sorted(wanted - set(ids)):
        raise unknown("figure", id, ids)
    chosen = [f for f in FIGURES if f.id in wanted]
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    saved = []
    for done, figure in enumerate(chosen, start=1):
        drawing, caption = figure.draw(quick)
        name = f"{figure.id}.png"
        style.write(drawing, directory / name)
        saved.append((figure, name, caption))
        if progress is not None:
            progress(done, len(chosen), figure)
    kept = [entry for entry in standing(directory) if entry[0].id not in wanted]
    listed = {figure.id: [name, caption] for figure, name, caption in (*kept, *saved)}
    (directory / CAPTIONS).write_text(json.dumps(listed, indent=1) + "\n")
    return saved


def standing(directory: str | Path) -> list[tuple[Figure, str, str]]:
    """The figures that were saved there before, as `save` returns them; none where there is no list of them."""
    path = Path(directory) / CAPTIONS
    if not path.exists():
        return []
    known = json.loads(path.read_text())
    return [(f, *known[f.id]) for f in FIGURES if f.id in known and (Path(directory) / known[f.id][0]).exists()]


__all__ = ["FIGURES", "Figure", "save", "standing"]
