"""The figure of an advice: error against seconds of the candidates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.benchmarks import style
from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .table import Advice, Advised

#: Role -> its words in the legend.
ROLES = {"choice": "choice", "own": "own", "peer": "peer", "runner_up": "runner-up", "next": "at a tenth"}
#: Errors below are drawn here: round-off, or none.
LEAST = 1e-17


@style.styled
def advice(found: Advice) -> Figure:
    """Draw seconds against error: each recommended integration with its own colour and marker, the others grey."""
    if found.choice is None:
        raise InvalidInput(f"there is nothing to draw: {found.why}")
    figure, ((axes,),) = style.panels(1, 1, 3.6)
    seen: dict[tuple[str, float, float], list[str]] = {}
    members: dict[tuple[str, float, float], Advised] = {}
    for role, words in ROLES.items():
        one: Advised | None = getattr(found, role)
        if one is not None:
            key = (one.integrator, one.error, one.seconds)
            seen.setdefault(key, []).append(words)
            members[key] = one
    for one in found.alternatives:
        if (one.integrator, one.error, one.seconds) not in members:
            axes.loglog(max(one.error, LEAST), one.seconds, ".", color=style.GREY)
            axes.annotate(one.integrator, (max(one.error, LEAST), one.seconds), color=style.GREY)
    for look, (key, one) in zip(style.looks(), members.items(), strict=False):
        label = f"{', '.join(seen[key])}: {one.integrator}"
        axes.loglog(max(one.error, LEAST), one.seconds, **look | {"linestyle": "none", "markersize": 7, "label": label})
    if found.accuracy is not None:
        axes.axvline(found.accuracy, color=style.GREY, linewidth=0.8, linestyle=":", label="accuracy asked for")
    axes.invert_xaxis()
    axes.set(xlabel=f"error of the {found.quantity}", ylabel="seconds, warm, without output")
    axes.set_title(f"{found.problem}, t = 0 to {found.t_end:g}")
    style.legend_above(figure, axes, 2)
    return figure
