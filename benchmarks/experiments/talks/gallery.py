"""FIGURES: a record for each figure of the two talks, drawn from measured rows.

Subjects: pendulum and symplectic maps, Lotka-Volterra, Henon-Heiles, perturbed Kepler, convergence.  To add a figure,
write functions ``measure(quick) -> rows`` (if ``quick``, of shorter runs) and ``draw(rows) -> (figure, caption)``, and
add a record.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from phasebench.benchmarks import style
from phasebench.benchmarks.page.page import Picture

from . import convergence, henon_heiles, linear_map, lotka_volterra, pendulum, perturbed_kepler
from .record import Figure

if TYPE_CHECKING:
    import pandas as pd

FIGURES: tuple[Figure, ...] = (
    *pendulum.FIGURES,
    *linear_map.FIGURES,
    *lotka_volterra.FIGURES,
    *henon_heiles.FIGURES,
    *perturbed_kepler.FIGURES,
    *convergence.FIGURES,
)


def pictures(curves: pd.DataFrame, section: str, folder: Path) -> list[Picture]:
    """Draw the figures of a section of the talks into ``folder``; return their files, titles and captions.

    ``curves`` is the table of all measured curves; a figure whose curves were not measured is left out.
    """
    drawn = []
    for figure in FIGURES:
        rows = curves[curves["figure"] == figure.id]
        if figure.section == section and (len(rows) or figure.measure is None):
            drawing, caption = figure.draw(rows)
            drawn.append(Picture(style.save(drawing, folder, f"{figure.id}.png"), figure.title, caption))
    return drawn
