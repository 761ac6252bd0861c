"""FIGURES: every figure of the talks, one record each, drawn from measured rows.

The figures are those of the two talks: pendulum and symplectic maps, Lotka-Volterra, Henon-Heiles, perturbed Kepler,
convergence.  A new figure is a function ``measure(quick) -> rows``, a function ``draw(rows) -> (figure, caption)`` and
one more record.
"""

from __future__ import annotations

from pathlib import Path

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.page import Picture

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


def pictures(curves, section: str, folder: Path) -> list[Picture]:
    """The figures of a section, drawn from the table of curves into ``folder``; without rows a figure is left out."""
    drawn = []
    for figure in FIGURES:
        rows = curves[curves["figure"] == figure.id]
        if figure.section == section and (len(rows) or figure.measure is None):
            drawing, caption = figure.draw(rows)
            drawn.append(Picture(style.save(drawing, folder, f"{figure.id}.png"), figure.title, caption))
    return drawn
