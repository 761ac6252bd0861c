"""Work-precision diagrams (error against time) of methods and of other packages' integrators, on any problem."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from phasebench.benchmarks import style
from phasebench.benchmarks.advice.ask import ask
from phasebench.benchmarks.advice.portfolio import portfolio
from phasebench.benchmarks.ladder.curves import curves
from phasebench.benchmarks.measure.global_error import known_truth, with_start
from phasebench.benchmarks.measure.integrator import OURS, YOURS, AnyProblem, Integrator, integrator
from phasebench.benchmarks.measure.named_quantities import quantity as quantity_of
from phasebench.benchmarks.measure.own_step import Step
from phasebench.benchmarks.measure.tabular import TabularResult
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import State, check_names
from phasebench.integrators.record import Method
from phasebench.reference.peers import Peer

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from phasebench.benchmarks.problems.base import Problem

#: The accuracies of the table, and the largest number of curves in a figure.
ACCURACIES = tuple(10.0**-k for k in range(1, 14, 2))
CURVES = 9
#: If no integrator is named: the number taken of each side, and the accuracy for which they are chosen.
CHOSEN, MIDDLE = 4, 1e-6
#: Larger errors are left out of a figure.
LARGEST = 1e3
#: Permitted file endings of a figure.
SUFFIXES = (".png", ".svg", ".pdf")
#: Characters per line of the title, and the largest number of lines.
LINE, LINES = 90, 3


@dataclass(frozen=True, repr=False)
class WorkPrecision(TabularResult):
    """Error against time of several integrators on one problem; it prints as a table.

    Attributes
    ----------
    rows : a dictionary for each run, from coarse to fine for each integrator: problem, t_end, quantity, method, id,
        kind (this project, the user, or a package), h or tol, steps, error, uncertainty (of the reference), seconds,
        status, reason
    """

    rows: tuple[dict[str, Any], ...]

    @property
    def methods(self) -> list[str]:
        """The labels of the integrators, in the order of the rows."""
        return list(dict.fromkeys(r["method"] for r in self.rows))

    @property
    def title(self) -> str:
        """Title of the figure: the quantity whose error is shown, the problem and the time span."""
        first = self.rows[0]
        return f"error of the {first['quantity']} of {first['problem']}, t = 0 to {first['t_end']:g}"

    def table(self) -> Iterable[dict[str, str]]:
        """Yield a dict for each integrator: the seconds of its cheapest run at each accuracy, and its least error."""
        for method in self.methods:
            ended = [r for r in self.rows if r["method"] == method and r["status"] == "ok"]
            line = {"method": method}
            for accuracy in ACCURACIES:
                enough = [r["seconds"] for r in ended if r["error"] + r["uncertainty"] <= accuracy]
                line[f"{accuracy:.0e}"] = f"{min(enough):.2g}" if enough else "-"
            line["least error"] = f"{min(r['error'] for r in ended):.1e}" if ended else "-"
            yield line

    def to_frame(self) -> pd.DataFrame:
        """The rows as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(list(self.rows))

    def _heading(self) -> list[str]:
        return [f"seconds for an {self.title}"]

    def _printed(self) -> pd.DataFrame:
        import pandas as pd

        return pd.DataFrame(list(self.table()))

    @overload
    def plot(self) -> Figure: ...
    @overload
    def plot(self, path: str | Path) -> Path: ...
    def plot(self, path: str | Path | None = None) -> Figure | Path:
        """The figure; with a path it is written to a .png, .svg or .pdf file, and the path returned.

        Raises InvalidInput for another ending, or if the file cannot be written.
        """
        if path is None:
            return draw(self)
        path = Path(path)
        if path.suffix.lower() not in SUFFIXES:
            raise InvalidInput(f"the figure is {path}; its ending must be {', '.join(SUFFIXES)}")
        try:
            style.write(draw(self), path)
        except OSError as error:
            raise InvalidInput(f"{path} cannot be written: {error.strerror or error}") from None
        return path


@check_names
def workprecision(
    problem: AnyProblem,
    methods: str | Path | Sequence[str | Path | Method | Peer | Integrator | Step] | None = None,
    *,
    t_end: float,
    quantity: str = "end-state",
    q0: State | None = None,
    p0: State | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> WorkPrecision:
    """Measure error against time over steps and tolerances, from the coarsest that work to round-off.

    Parameters
    ----------
    problem : a system with q0 and p0; a problem; a registered name such as ``"henon-heiles:box"``; or a file's path
    methods : ids of methods and peers (integrators of other packages), users' own steps, or paths of files with one;
        by default a few methods and a few peers
    t_end : the end of the span
    quantity : ``"end-state"``, ``"trajectory"``, ``"energy"``, or the name of one of the problem's own quantities
    q0, p0 : arrays (d,), the initial state if not the problem's
    progress : called with the name of each integrator

    Returns
    -------
    WorkPrecision

    Raises
    ------
    InvalidInput
        For unusable input, if there is no reference of the quantity at ``t_end`` (past the horizon of a chaotic orbit
        there is none), or if an integrator is not applicable to the problem.

    Examples
    --------
    >>> found = workprecision("pendulum", ["stormer-verlet", "heyoka"], t_end=10.0)  # doctest: +SKIP
    >>> found.plot("pendulum.svg")  # doctest: +SKIP
    """
    if isinstance(t_end, bool) or not isinstance(t_end, (int, float)) or not isfinite(t_end) or not t_end > 0:
        raise InvalidInput(f"t_end is {t_end!r}; it must be a positive number")
    made = with_start(problem_of(problem) if isinstance(problem, (str, Path)) else problem, q0, p0)
    wanted = quantity_of(made, quantity)
    methods = [methods] if isinstance(methods, (str, Path)) else methods
    chosen = [integrator(m) for m in methods] if methods else promising(made, t_end, quantity)
    true = known_truth(made, wanted, float(t_end))
    return WorkPrecision(tuple(curves(made, float(t_end), wanted, chosen, progress, true)))


def promising(problem: Problem, t_end: float, quantity: str) -> list[Integrator]:
    """Return the few methods of this project expected to be fastest on the problem, then as many peers.

    Peers are integrators of other packages.  There are at most `CHOSEN` of either kind.  The expected times, to reach
    the error `MIDDLE` of the ``quantity``, come from stored measurements.
    """
    members = [i for i, _ in portfolio(ask(problem, t_end=t_end, accuracy=MIDDLE, quantity_name=quantity), MIDDLE)[0]]
    own, others = ([i for i in members if (i.kind == OURS) is side][:CHOSEN] for side in (True, False))
    return [*own, *others]


# -- the figure -------------------------------------------------------------------------------------------------------


def improving(rows: Sequence[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Split one integrator's rows, from coarse to fine: (rows with an error below all coarser ones, the other rows).

    A figure joins only the first list by a line; the other rows scatter at the level of round-off, where a line would
    make loops.
    """
    best, falling, rest = float("inf"), [], []
    for row in rows:
        (falling if row["error"] < best else rest).append(row)
        best = min(best, row["error"])
    return falling, rest


def side(kind: str) -> tuple[str, str]:
    """Return (line style, text in the legend) for an integrator's ``kind``.

    There are three: a method of this project, the user's own step, and a peer (an integrator of another package).
    """
    return {OURS: ("-", "phasebench"), YOURS: ("-.", "own step")}.get(kind, ("--", "peer"))


def draw(found: WorkPrecision) -> Figure:
    """Draw error against seconds, a curve per integrator with its colour and marker.

    Curves of peers (integrators of other packages) are dashed, with open markers.
    """
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 4.6)
        for name, look in zip(found.methods[:CURVES], style.looks(), strict=False):
            rows = [r for r in found.rows if r["method"] == name and r["status"] == "ok" and 0 < r["error"] < LARGEST]
            line, words = side(next(r["kind"] for r in found.rows if r["method"] == name))
            falling, rest = improving(rows)
            look |= {"linestyle": line, "markerfacecolor": "white" if words == "peer" else look["color"]}
            label = name if words == "phasebench" else f"{name} ({words})"
            axes.loglog(*_points(falling), label=label, **look)
            axes.loglog(*_points(rest), **look | {"linestyle": "none", "alpha": 0.45})
        known = found.rows[0]["uncertainty"]
        if known > 0:
            axes.axvline(known, color=style.GREY, linewidth=0.8, linestyle=":", label="uncertainty of the reference")
        axes.invert_xaxis()
        axes.grid(True, which="major", color="#dddddd", linewidth=0.5)
        axes.set_axisbelow(True)
        axes.set(xlabel=f"error of the {found.rows[0]['quantity']}", ylabel="seconds, warm, without output")
        axes.set_title(
            "\n".join(textwrap.wrap(f"Time for an {found.title}", LINE, max_lines=LINES, placeholder=" ..."))
        )
        style.legend_above(figure, axes, 3)
    return figure


def _points(rows: Sequence[dict[str, Any]]) -> tuple[list[float], list[float]]:
    return [r["error"] for r in rows], [r["seconds"] for r in rows]
