r"""Convergence on the chaotic Henon-Heiles orbit at t = 1: refinement differences :math:`\|y_h - y_{2h}\|_\infty`.

The talk's tables show this quantity, the difference of successive refinements in the maximum norm over (q, p).  It is
not the error against the exact solution, but falls with the same order.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), tables
'Convergence rates' and 'Convergence tests with chaotic orbits at t = 1'; H. Yoshida, Phys. Lett. A 150 (1990) 262-268;
M. Suzuki, Phys. Lett. A 146 (1990) 319-323 (compositions).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.store.arrays import unpack

from . import measure
from .measure import LAMBDAS, Figure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

PROBLEM = "henon-heiles:chaotic"
#: Panel title -> (method id, order, which is the slope of the grey line).
SCHEMES = {"Scheme I": ("scheme-i", 1), "Scheme II": ("scheme-ii", 2), "Scheme III": ("scheme-iii", 2)}
PRESERVING = {"AVF": "avf", "Scheme IV": "scheme-iv", "Scheme V": "scheme-v"}
#: Curve label -> (method id, order).
COMPOSITIONS = {
    "III, Yoshida 4": ("scheme-iii-yoshida-4", 4),
    "III, Suzuki 4": ("scheme-iii-suzuki-4", 4),
    "V, Yoshida 4": ("scheme-v-yoshida-4", 4),
    "V, Suzuki 4": ("scheme-v-suzuki-4", 4),
    "III, Yoshida 6": ("scheme-iii-yoshida-6", 6),
    "III, Suzuki 6": ("scheme-iii-suzuki-6", 6),
}
ORDINATE = r"$\|y_h - y_{2h}\|_\infty$"


def _row(panel: str, curve: str, id: str, steps: Sequence[int], **parameters: Any) -> dict:
    """Measure one curve: refinement differences |y_h - y_2h| of the method ``id`` over doubling numbers of ``steps``.

    The orbit is the chaotic one of Henon-Heiles, to t = 1.  Returns the curve's row, with the observed order; ``panel``
    is the title of the panel that shows it ("" if there is one panel), ``curve`` its label.
    """
    h, differences, runs = measure.refinement_differences(measure.start(PROBLEM), id, steps, **parameters)
    worst = next((s for s in runs if s.status != "ok"), runs[-1])
    counts = {k: sum(s.counts[k] for s in runs) for k in ("steps", "fallbacks")}
    row = measure.row(panel, curve, h, differences, worst) | counts
    return row | {"order": measure.observed_order(h, differences)}


def _steps(first: int, halvings: int) -> list[int]:
    """Numbers of steps to t = 1: ``first``, and its doublings."""
    return [first * 2**k for k in range(halvings + 1)]


def _measure_schemes() -> list[dict]:
    steps = _steps(6, 7)
    return [_row(title, f"λ = {lam}", id, steps, lam=lam) for title, (id, _) in SCHEMES.items() for lam in LAMBDAS]


def _measure_preserving() -> list[dict]:
    return [_row("", title, id, _steps(6, 7)) for title, id in PRESERVING.items()]


def _measure_compositions() -> list[dict]:
    return [_row("", title, id, _steps(2, 9)) for title, (id, _) in COMPOSITIONS.items()]


def _curves(axes: Axes, rows: pd.DataFrame) -> tuple[np.ndarray, list[np.ndarray]]:
    """A curve for each of ``rows`` in the panel ``axes``: (step sizes, refinement differences of each curve)."""
    differences = []
    for k, r in enumerate(rows.itertuples()):
        h, e = unpack(r.x), unpack(r.y)
        axes.loglog(h, measure.for_log_axis(e), label=r.curve, **style.curve(k))
        differences.append(e)
    axes.set(xlabel="$h$")
    axes.grid(color="0.9", linewidth=0.5)
    return h, differences


def _caption(methods: str, rows: pd.DataFrame) -> str:
    h = unpack(rows["x"].iloc[0])
    return (
        "Refinement difference max |y_h - y_2h| over q and p at t = 1 on the chaotic Hénon–Heiles orbit, h = "
        f"1/{round(1 / h[0])} to 1/{round(1 / h[-1])} by halving, of {methods}."
        f"{measure.floor_note(map(unpack, rows['y']))}{measure.troubles(rows)}"
    )


@style.styled
def schemes_i_to_iii(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The refinement differences |y_h - y_2h| of Schemes I, II and III over h."""
    figure, (panels,) = style.panels(1, 3, 3.0, sharey=True)
    drawn = []
    for axes, (title, (_, order)) in zip(panels, SCHEMES.items(), strict=True):
        drawn.append((axes, order, *_curves(axes, rows[rows["panel"] == title])))
        axes.set_title(f"{title}; grey: slope {order}")
    panels[0].set_ylabel(ORDINATE)
    style.legend_above(figure, panels[0], len(LAMBDAS))
    for axes, order, h, differences in drawn:
        style.slope(axes, h, differences, order)
    return figure, _caption("Schemes I, II and III", rows)


@style.styled
def preserving(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The refinement differences |y_h - y_2h| of energy-preserving methods over h."""
    figure, ((axes,),) = style.panels(1, 1, 3.4)
    h, differences = _curves(axes, rows)
    for order, line in ((1, "--"), (2, "-")):
        style.slope(axes, h, differences, order, line)
    axes.set_ylabel(ORDINATE)
    figure.legend(loc="outside right upper", handlelength=3.4)
    return figure, _caption("AVF, Schemes IV and V", rows)


@style.styled
def compositions(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """The refinement differences |y_h - y_2h| of compositions of orders 4 and 6 over h."""
    figure, ((axes,),) = style.panels(1, 1, 3.6)
    h, differences = _curves(axes, rows)
    for order, line in ((4, "-"), (6, "--")):
        group = [e[:5] for e, title in zip(differences, rows["curve"], strict=True) if COMPOSITIONS[title][1] == order]
        style.slope(axes, h[:5], [np.where(e > measure.NOISE, e, 0) for e in group], order, line)
    axes.set_ylabel(ORDINATE)
    figure.legend(loc="outside right upper", handlelength=3.4)
    return figure, _caption("compositions of Scheme III (λ = 1/3) and of Scheme V", rows)


FIGURES = (
    Figure("convergence-schemes-i-iii", "Convergence of Schemes I, II and III", _measure_schemes, schemes_i_to_iii),
    Figure("convergence-preserving", "Convergence of AVF, Schemes IV and V", _measure_preserving, preserving),
    Figure(
        "convergence-compositions",
        "Convergence of the higher-order compositions",
        _measure_compositions,
        compositions,
    ),
)
