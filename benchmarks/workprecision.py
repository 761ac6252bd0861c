"""Error against time of methods and peers on any problem: rows, a table and a figure."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from phasebench.benchmarks.advice import ladder
from phasebench.benchmarks.measure.global_error import started
from phasebench.benchmarks.measure.integrator import OURS, YOURS, integrator
from phasebench.benchmarks.measure.quantities import quantity as quantity_of
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import initial

#: The accuracies of the table, and the most curves of a figure.
ACCURACIES = tuple(10.0**-k for k in range(1, 14, 2))
CURVES = 9
#: The largest error of a figure: beyond it nothing is told.
LARGEST = 1e3
#: Endings of a figure's file.
SUFFIXES = (".png", ".svg", ".pdf")
#: Characters of a line of the title, and lines.
LINE, LINES = 90, 3


@dataclass(frozen=True, repr=False)
class WorkPrecision:
    """Error against time of several integrators on one problem; it prints as a table.

    Attributes
    ----------
    rows : a dictionary for each run, the coarsest of an integrator first: problem, t_end, quantity, method, id, kind,
        h or tol, steps, error, uncertainty (of the reference), seconds, status, reason
    """

    rows: tuple[dict[str, Any], ...]

    @property
    def methods(self) -> list[str]:
        """The integrators, in the order of the rows."""
        return list(dict.fromkeys(r["method"] for r in self.rows))

    @property
    def title(self) -> str:
        """The quantity, the problem and the span."""
        first = self.rows[0]
        return f"error of the {first['quantity']} of {first['problem']}, t = 0 to {first['t_end']:g}"

    def table(self) -> Iterable[dict[str, str]]:
        """A line for each integrator: the seconds of its cheapest run at each accuracy, and its least error."""
        for method in self.methods:
            ended = [r for r in self.rows if r["method"] == method and r["status"] == "ok"]
            line = {"method": method}
            for accuracy in ACCURACIES:
                enough = [r["seconds"] for r in ended if r["error"] + r["uncertainty"] <= accuracy]
                line[f"{accuracy:.0e}"] = f"{min(enough):.2g}" if enough else "-"
            line["least error"] = f"{min(r['error'] for r in ended):.1e}" if ended else "-"
            yield line

    def to_frame(self):
        """The rows as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(list(self.rows))

    def __repr__(self) -> str:
        import pandas as pd

        return f"seconds for an {self.title}\n{pd.DataFrame(list(self.table())).to_string(index=False)}"

    def plot(self, path: str | Path) -> Path:
        """Write the figure to a file .png, .svg or .pdf; returns its path.

        Raises InvalidInput for another ending, or where nothing can be written.
        """
        path = Path(path)
        if path.suffix.lower() not in SUFFIXES:
            raise InvalidInput(f"the figure is {path}; its ending must be {', '.join(SUFFIXES)}")
        draw(self, path)
        return path


def workprecision(
    problem,
    methods: Sequence | None = None,
    *,
    t_end: float,
    quantity: str = "end-state",
    q0=None,
    p0=None,
    progress: Callable[[str], None] = lambda line: None,
) -> WorkPrecision:
    """Measure error against time over steps and tolerances, from where a method breaks to round-off.

    Parameters
    ----------
    problem : a system with q0 and p0; a problem; a registered name such as ``"henon-heiles:box"``; or a file's path
    methods : ids of methods and peers, steps of one's own, or paths of files with one; at first a few of each side
    t_end : the end of the span
    quantity : ``"end-state"``, ``"trajectory"``, ``"energy"``, or a name of the problem's own
    q0, p0 : arrays (d,), the initial state where not the problem's
    progress : called with the name of each integrator

    Returns
    -------
    WorkPrecision

    Raises
    ------
    InvalidInput
        For input that cannot be used, where there is no reference, or where an integrator cannot do the problem.

    Examples
    --------
    >>> found = workprecision("pendulum", ["stormer-verlet", "heyoka"], t_end=10.0)  # doctest: +SKIP
    >>> found.plot("pendulum.svg")  # doctest: +SKIP
    """
    if isinstance(t_end, bool) or not isinstance(t_end, (int, float)) or not isfinite(t_end) or not t_end > 0:
        raise InvalidInput(f"t_end is {t_end!r}; it must be a positive number")
    made = _problem(problem, q0, p0)
    ask = ladder.asked(made, float(t_end), quantity_of(made, quantity))
    methods = [methods] if isinstance(methods, (str, Path)) else methods
    chosen = ladder.chosen(ask) if not methods else [integrator(m) for m in methods]
    return WorkPrecision(tuple(ladder.ladders(ask, chosen, progress)))


def _problem(problem, q0, p0) -> Problem:
    """The problem from the state that is given."""
    made = problem_of(problem) if isinstance(problem, (str, Path)) else problem
    if isinstance(made, Problem):
        return started(made, q0, p0)
    system, q, p = initial(made, q0, p0)
    return Problem(
        "given", "a system of one's own", "", system, (Orbit("given", tuple(q.tolist()), tuple(p.tolist())),)
    )


# -- the figure -------------------------------------------------------------------------------------------------------


def improving(rows: Sequence[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The rows of one integrator whose error is smaller than of all coarser ones, and the others.

    A line joins the first; where round-off ends the fall the others scatter, and to join them would draw loops.
    """
    best, falling, rest = float("inf"), [], []
    for row in rows:
        (falling if row["error"] < best else rest).append(row)
        best = min(best, row["error"])
    return falling, rest


def side(kind: str) -> tuple[str, str]:
    """(line style, what the legend says) of this project's methods, the user's own, and peers."""
    return {OURS: ("-", "phasebench"), YOURS: ("-.", "own step")}.get(kind, ("--", "peer"))


def draw(found: WorkPrecision, path: Path) -> None:
    """Error against seconds, a curve an integrator: a colour and a marker each, peers dashed with open markers."""
    from phasebench.benchmarks.page import style

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
        try:
            style.write(figure, path)
        except OSError as error:
            raise InvalidInput(f"{path} cannot be written: {error.strerror or error}") from None


def _points(rows: Sequence[dict[str, Any]]) -> tuple[list[float], list[float]]:
    return [r["error"] for r in rows], [r["seconds"] for r in rows]
