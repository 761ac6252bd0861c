"""Figures of results: a solution, a section, an ensemble."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks import style
from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from phasebench.integrators.ensemble import Ensemble
    from phasebench.integrators.section import Section
    from phasebench.integrators.solution import Solution

#: Points of a curve; more are thinned.
POINTS = 20_000
HEIGHT = 3.2


@style.styled
def solution(found: Solution) -> Figure:
    """Draw H - H(0) (or, without an energy, the first coordinate) over time, and the orbit in (q, p), or (q1, q2)."""
    system, title = found.system, f"{found.method.label}, h = {found.h:.6g}: {found.status}"
    figure, ((left, right),) = style.panels(1, 2, HEIGHT)
    some = slice(None, None, 1 + len(found.t) // POINTS)
    look = {"color": style.BLUE, "linewidth": 0.9}
    if system.has_energy:
        energy = found.energy()
        left.plot(found.t[some], (energy - energy[0])[some], **look)
        left.axhline(0, color=style.GREY, linewidth=0.6)
        left.set(xlabel="time", ylabel="H - H(0)" if system.driven else "energy error H - H(0)", title=title)
    else:
        left.plot(found.t[some], found.q[some, 0], **look)
        left.set(xlabel="time", ylabel=str(system.q[0]), title=f"{title}; no energy")
    several = found.q.shape[1] > 1
    x, y = (found.q[:, 0], found.q[:, 1]) if several else (found.q[:, 0], found.p[:, 0])
    names = (system.q[0], system.q[1]) if several else (system.q[0], system.p[0])
    right.plot(x[some], y[some], **look)
    right.plot(x[0], y[0], "o", color=style.VERMILION, label="start")
    right.set(xlabel=str(names[0]), ylabel=str(names[1]), title="orbit" if several else "phase portrait")
    right.legend(loc="best")
    return figure


@style.styled
def section(found: Section) -> Figure:
    """Draw the crossings of a Poincare section in the plane of a coordinate and its momentum, coloured by orbit.

    It is the first pair of which the section fixes none.  Raises InvalidInput for one degree of freedom.
    """
    names, d = found.names, found.q.shape[1]
    if d < 2:
        raise InvalidInput("a section of one degree of freedom is a few points: see to_frame()")
    other = next(k for k in range(d) if k != found.component % d)
    figure, ((axes,),) = style.panels(1, 1, 4.2)
    for k, orbit in enumerate(np.unique(found.orbit)):
        mine = found.orbit == orbit
        colour = style.CURVES[k % len(style.CURVES)][0]
        axes.plot(found.q[mine, other], found.p[mine, other], ".", color=colour, markersize=2.5)
    axes.set(xlabel=names[other], ylabel=names[d + other])
    axes.set_title(f"{len(found)} crossings of {found.of} = {found.at:g} by {len(found.status)} orbits")
    return figure


@style.styled
def ensemble(found: Ensemble) -> Figure:
    """Draw the end states of an ensemble's orbits in the plane of the first q and p, with a marker for each status."""
    figure, ((axes,),) = style.panels(1, 1, 4.2)
    d = found.q.shape[1]
    for look, status in zip(style.looks(), _statuses(found.status), strict=False):
        mine = found.status == status
        mark: dict[str, Any] = look | {"linestyle": "none", "label": f"{status}: {int(mine.sum())}"}
        axes.plot(found.q[mine, 0], found.p[mine, 0], **mark)
    axes.set(xlabel=found.names[0], ylabel=found.names[d], title=f"end states of {len(found)} orbits")
    style.legend_above(figure, axes, 4)
    return figure


def _statuses(status: np.ndarray) -> list[str]:
    names, numbers = np.unique(status.astype(str), return_counts=True)
    return [str(names[k]) for k in np.argsort(-numbers)]
