r"""Convergence on the chaotic Henon-Heiles orbit at t = 1: refinement differences :math:`\|y_h - y_{2h}\|_\infty`.

This is the quantity of the talk's tables, the difference of successive refinements in the maximum norm over (q, p);
it is no error against the exact solution, but falls with the same order.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), tables
'Convergence rates' and 'Convergence tests with chaotic orbits at t = 1'; H. Yoshida, Phys. Lett. A 150 (1990) 262-268;
M. Suzuki, Phys. Lett. A 146 (1990) 319-323 (compositions).
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.page import style

from . import measure
from .measure import LAMBDAS
from .record import Figure

SECTION = "convergence"
PROBLEM = "henon-heiles:chaotic"
SCHEMES = (("Scheme I", "scheme-i", 1), ("Scheme II", "scheme-ii", 2), ("Scheme III", "scheme-iii", 2))
PRESERVING = (("AVF", "avf"), ("Scheme IV", "scheme-iv"), ("Scheme V", "scheme-v"))
#: (label, method, order)
COMPOSITIONS = (
    ("III, Yoshida 4", "scheme-iii-yoshida-4", 4),
    ("III, Suzuki 4", "scheme-iii-suzuki-4", 4),
    ("V, Yoshida 4", "scheme-v-yoshida-4", 4),
    ("V, Suzuki 4", "scheme-v-suzuki-4", 4),
    ("III, Yoshida 6", "scheme-iii-yoshida-6", 6),
    ("III, Suzuki 6", "scheme-iii-suzuki-6", 6),
)


class _Panel:
    """The curves of one panel, and what the caption says of them."""

    def __init__(self, axes, steps):
        self.axes, self.steps = axes, steps
        self.words, self.differences, self.runs = [], [], []
        axes.set(xlabel="$h$")
        axes.grid(color="0.9", linewidth=0.5)

    def curve(self, label: str, id: str, mathematical: str | None = None, **parameters) -> None:
        """Measure and draw a method's refinement differences."""
        self.h, e, runs = measure.refinement_differences(measure.start(PROBLEM), id, self.steps, **parameters)
        self.axes.loglog(self.h, measure.shown(e), label=mathematical or label, **style.curve(len(self.words)))
        self.words.append(f"{label}: {measure.observed_order(self.h, e):.2f}")
        self.differences.append(e)
        self.runs += runs


def _caption(methods: str, panels, slopes: str) -> str:
    h = panels[0].h
    errors = [e for panel in panels for e in panel.differences]
    return (
        "Refinement difference max |y_h - y_2h| over q and p at t = 1 on the chaotic Henon-Heiles orbit, h = "
        f"1/{round(1 / h[0])} to 1/{round(1 / h[-1])} by halving, of {methods}. Slopes over the three smallest steps "
        f"with differences above {measure.NOISE:g}: {slopes}.{measure.floor_note(errors)}"
        f"{measure.troubles([s for panel in panels for s in panel.runs])}"
    )


def _steps(first: int, halvings: int) -> list[int]:
    """Doubling numbers of steps to t = 1."""
    return [first * 2**k for k in range(halvings + 1)]


@style.drawn
def schemes_i_to_iii(quick: bool):
    """Schemes I, II and III over lambda."""
    figure, (row,) = style.panels(1, 3, 3.0, sharey=True)
    panels = []
    for axes, (title, id, order) in zip(row, SCHEMES, strict=True):
        panel = _Panel(axes, _steps(6, 4 if quick else 7))
        for lam in LAMBDAS:
            panel.curve(f"lambda = {lam}", id, f"$\\lambda$ = {lam}", lam=lam)
        axes.set_title(f"{title}; grey: slope {order}")
        panels.append(panel)
    row[0].set_ylabel("$\\|y_h - y_{2h}\\|_\\infty$")
    style.legend_above(figure, row[0], len(LAMBDAS))
    for panel, (_, _, order) in zip(panels, SCHEMES, strict=True):
        style.slope(panel.axes, panel.h, panel.differences, order)
    slopes = "; ".join(
        f"{title} {', '.join(panel.words)}" for (title, _, _), panel in zip(SCHEMES, panels, strict=True)
    )
    return figure, _caption("Schemes I, II and III", panels, slopes)


@style.drawn
def preserving(quick: bool):
    """AVF, Schemes IV and V."""
    figure, ((axes,),) = style.panels(1, 1, 3.4)
    panel = _Panel(axes, _steps(6, 4 if quick else 7))
    for title, id in PRESERVING:
        panel.curve(title, id)
    for order, line in ((1, "--"), (2, "-")):
        style.slope(axes, panel.h, panel.differences, order, line)
    axes.set_ylabel("$\\|y_h - y_{2h}\\|_\\infty$")
    figure.legend(loc="outside right upper", handlelength=3.4)
    return figure, _caption("AVF, Schemes IV and V", [panel], ", ".join(panel.words))


@style.drawn
def compositions(quick: bool):
    """Compositions of order 4 and 6 of Schemes III and V."""
    figure, ((axes,),) = style.panels(1, 1, 3.6)
    panel = _Panel(axes, _steps(2, 6 if quick else 9))
    for title, id, _ in COMPOSITIONS:
        panel.curve(title, id)
    for order, line in ((4, "-"), (6, "--")):
        group = [e[:5] for e, (_, _, p) in zip(panel.differences, COMPOSITIONS, strict=True) if p == order]
        style.slope(axes, panel.h[:5], [np.where(e > measure.NOISE, e, 0) for e in group], order, line)
    axes.set_ylabel("$\\|y_h - y_{2h}\\|_\\infty$")
    figure.legend(loc="outside right upper", handlelength=3.4)
    methods = "compositions of Scheme III (lambda = 1/3) and of Scheme V"
    return figure, _caption(methods, [panel], ", ".join(panel.words))


FIGURES = (
    Figure("convergence-schemes-i-iii", "Convergence of Schemes I, II and III", SECTION, schemes_i_to_iii),
    Figure("convergence-preserving", "Convergence of AVF, Schemes IV and V", SECTION, preserving),
    Figure("convergence-compositions", "Convergence of the higher-order compositions", SECTION, compositions),
)
