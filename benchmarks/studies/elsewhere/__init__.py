"""Results from other machines beside this suite's methods: errors at as many evaluations, never times.

A file holds rows (method, step or tolerance, evaluations, end state or energy error) that another package produced on
another machine.  A method here with the same coefficients (`TWINS`) is run with the same step: the energy errors of
both have to agree, which tests the file and this suite.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study, over
from phasebench.benchmarks.store import elsewhere
from phasebench.benchmarks.store.cells import ProblemKey, states
from phasebench.benchmarks.store.elsewhere import Elsewhere
from phasebench.integrators.driver import OK
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import BY_ID

FOLDER = Path(__file__).parent
THEIRS, OURS, BY = "elsewhere", "elsewhere_own", "measured elsewhere by"
#: Methods of this suite that are run beside the rows.
METHODS = ("stormer-verlet", "pefrl", "mclachlan-atela-5", "blanes-moan-srkn14a", "gauss-4")
#: (package, method there) -> the method here that has its coefficients.
TWINS = {
    ("SUNDIALS", "ARKODE_SPRK_EULER_1_1"): "symplectic-euler-p",
    ("SUNDIALS", "ARKODE_SPRK_LEAPFROG_2_2"): "stormer-verlet-dkd",
    ("SUNDIALS", "ARKODE_SPRK_PSEUDO_LEAPFROG_2_2"): "stormer-verlet",
    ("SUNDIALS", "ARKODE_SPRK_MCLACHLAN_2_2"): "mclachlan-atela-2",
    ("SUNDIALS", "ARKODE_SPRK_RUTH_3_3"): "ruth-3",
    ("SUNDIALS", "ARKODE_SPRK_MCLACHLAN_3_3"): "mclachlan-atela-3",
    ("SUNDIALS", "ARKODE_SPRK_MCLACHLAN_4_4"): "mclachlan-atela-4",
    ("SUNDIALS", "ARKODE_SPRK_MCLACHLAN_5_6"): "mclachlan-atela-5",
    ("SUNDIALS", "ARKODE_SPRK_YOSHIDA_6_8"): "yoshida-6a",
}
#: Largest number of evaluations of a run here, and of runs of a method.
MOST, RUNS = 400_000, 12
#: Least share of a budget that a compared run takes; largest factor between the numbers of steps of two tries.
USED, SHORTEN = 0.5, 1.25
#: Energy errors of the same method and step are the same within this; smaller errors are drawn at the second.
SAME, LEAST = 1e-12, 1e-16


def compare(file: Elsewhere, methods: Sequence[str] | None = None) -> tuple[list[dict], list[dict]]:
    """The rows of a file with their errors and those of twins, and rows of methods here with as many evaluations.

    ``methods`` are by default those of `METHODS` that can integrate the problem.  Raises InvalidInput if a given method
    is unknown, cannot integrate the problem, or takes no fixed step.
    """
    theirs = [row | twin(file, row) for row in elsewhere.errors(file)]
    budgets = sorted({row["evaluations"] for row in theirs if row["evaluations"] <= MOST})
    ours = []
    for chosen in map(integrator, METHODS if methods is None else methods):
        lack = chosen.lacks(file.problem) or ("it takes no fixed step" if chosen.adaptive else None)
        if lack and methods is not None:
            raise InvalidInput(f"'{chosen.id}' cannot be compared: {lack}")
        ours += [] if lack else ladder(file, chosen, budgets[:: max(1, -(-len(budgets) // RUNS))])
    return theirs, ours


def ladder(file: Elsewhere, chosen: Integrator, budgets: Sequence[int]) -> list[dict]:
    """A run with as many steps as each budget of evaluations allows; left out if it takes less than `USED` of it."""
    rows: dict[int, dict] = {}
    price = 1.0
    for budget in sorted(budgets, reverse=True):
        steps = int(budget / price)
        while steps >= 1 and (row := run(file, chosen, steps))["evaluations"] > budget:
            # An implicit method's steps become dearer as they become longer.
            steps = min(steps - 1, int(steps / min(row["evaluations"] / budget, SHORTEN)))
        if steps >= 1 and row["evaluations"] >= USED * budget:
            price, rows[steps] = row["evaluations"] / steps, row
    return [{"file": file.path.name, "method": chosen.id} | rows[steps] for steps in sorted(rows)]


def run(file: Elsewhere, chosen: Integrator, steps: int) -> dict:
    """A run on a file's problem over its span, with the errors of its end, None if it failed."""
    made, h = file.problem, file.t_end / steps
    s = chosen.run(made, h=h, steps=steps, save_every=0)
    row = {"h": h, "steps": steps, "evaluations": s.counts["gradient"], "status": s.status, "reason": s.reason}
    if s.status != OK:
        return row | {"energy_error": None, "error": None, "uncertainty": None}
    start, end = made.system.observe(made.system.H, s.q[[0, -1]], s.p[[0, -1]])
    return row | {"energy_error": float(end - start)} | elsewhere.state_error(made, file.t_end, s.q[-1], s.p[-1])


def twin(file: Elsewhere, row: dict) -> dict:
    """The method here with the coefficients of a row's method, and its energy error with the same step."""
    id, error = TWINS.get((row["package"], row["method"])), None
    if id is not None and row["h"] is not None and row["evaluations"] <= MOST:
        steps = round(file.t_end / row["h"])
        if abs(steps * row["h"] / file.t_end - 1) <= elsewhere.SAME:
            error = run(file, integrator(id), steps)["energy_error"]
    return {"twin": id, "twin_energy_error": error}


def both(file: str) -> dict[str, list[dict]]:
    """The rows of a file in this folder, and those of this suite's methods."""
    return dict(zip((THEIRS, OURS), compare(elsewhere.read(FOLDER / file)), strict=True))


def needs(file: str) -> list[object]:
    """The text of a file, its problem with the certified states, and the methods."""
    name, parameters, package = elsewhere.problem_key(FOLDER / file)
    key, twins = ProblemKey(name, tuple(parameters.items())), [id for (by, _), id in TWINS.items() if by == package]
    return [(FOLDER / file).read_text(encoding="utf-8"), key, states(key.id), *(BY_ID[m] for m in (*METHODS, *twins))]


def apart(rows: pd.DataFrame) -> pd.Series:
    """The difference of the energy errors of a row and of the same method here."""
    return (rows["energy_error"] - rows["twin_energy_error"]).abs()


def farthest(rows: pd.DataFrame) -> str:
    """The row in which these differ most."""
    far = apart(rows)
    row = rows.loc[far.idxmax()]
    return f"{row['method']}, h = {number(row['h'])}: {number(far.max(), 2)} apart"


@of(THEIRS)
def packages(rows: pd.DataFrame) -> str:
    """The packages of the rows with their languages."""
    return join_list(list((rows["package"] + " (" + rows["language"] + ")").unique()), 3)


@picture(
    (THEIRS, OURS), "elsewhere", "energy error against evaluations",
    "Size of H − H₀ at the end against the evaluations: grey and hollow what was measured elsewhere, coloured this "
    "suite's methods, run here.",
)  # fmt: skip
def draw(theirs: pd.DataFrame, ours: pd.DataFrame) -> style.Figure:
    """Energy errors at the end over evaluations: a panel for each of the first two files."""
    files = list(theirs["file"].unique())[:2]
    figure, (panels,) = style.panels(1, len(files), 4.2)
    for axes, file in zip(panels, files, strict=True):
        part, own = theirs[theirs["file"] == file], ours[(ours["file"] == file) & (ours["status"] == OK)]
        names = list(part["method"].unique())
        same = next((k for k, letters in enumerate(zip(*names, strict=False)) if len({*letters}) > 1), 0)
        for side, first, grey in ((own, 0, {}), (part, same, {"color": "0.5", "mfc": "none", "lw": 0.7})):
            for k, (name, runs) in enumerate(side.groupby("method", sort=False)):
                size = runs["energy_error"].abs().clip(lower=LEAST)
                axes.loglog(runs["evaluations"], size, label=name[first:], **(style.curve(k) | grey))
        axes.set(xlabel="evaluations of the gradient", ylabel="|H − H₀| at the end", title=file)
        axes.grid(color="0.93", linewidth=0.5)
    style.legend_above(figure, panels[0], 4)
    return figure


@of(THEIRS, OURS)
def table(theirs: pd.DataFrame, ours: pd.DataFrame) -> Table:
    """The rows of each method with the fewest and the most evaluations, beside the least error here."""
    lines = []
    for _, part in theirs[theirs["evaluations"] <= MOST].groupby(["file", "method"], sort=False):
        ends = part.sort_values("evaluations").iloc[[0, -1]].drop_duplicates(subset="evaluations")
        lines += [_line(row, ours) for _, row in ends.iterrows()]
    caption = (
        f"Each method's row with the fewest evaluations, and with the most up to {MOST}; beside it the method of the "
        f"same coefficients, and the least error of {join_list(METHODS)}, run here with at most as many evaluations: "
        "what a low order costs, whoever runs it."
    )
    if len(lines) > ROWS:
        caption += f" {len(lines) - ROWS} more lines are in data/{THEIRS}.csv."
    return Table(pd.DataFrame(lines[:ROWS]), caption)


def _line(row: pd.Series, ours: pd.DataFrame) -> dict:
    column, what = ("energy_error", "energy error") if pd.isna(row["error"]) else ("error", "error of (q, p)")
    able = ours[(ours["file"] == row["file"]) & (ours["evaluations"] <= row["evaluations"]) & (ours["status"] == OK)]
    sizes = able.set_index("method")[column].astype(float).abs().dropna()
    least = sizes.min() if len(sizes) else None
    return {
        BY: f"{row['package']} {row['version']}, {row['language']}",
        "method": row["method"],
        "step": f"tol = {number(row['tol'])}" if pd.isna(row["h"]) else f"h = {number(row['h'])}",
        "evaluations": int(row["evaluations"]),
        "what": what,
        "error": number(abs(row[column])),
        "same here": row["twin"] if isinstance(row["twin"], str) else "",
        "least here": "" if least is None else sizes.idxmin(),
        "its error": "" if least is None else number(least) if least > LEAST else f"below {LEAST:g}",
    }


STUDY = Study(
    id="elsewhere",
    place=370,
    question="Do integrators measured on other machines have the errors that the same methods have here?",
    answer="{rows} rows of {packages} were measured on other machines; {same.n} of {same.of} that are run again here "
    "have the same energy error.",
    setting=(
        "Rows of integrators in other languages come as files, made on their own machine or taken from a published "
        "table; the format is checked when they are read.",
        "They are compared in errors and evaluations, never in time.",
        "An end state's error is computed here against the certified reference; an energy error, H − H₀ at the end, is "
        "the source's own where it gives no state.",
        "SUNDIALS: the Kepler problem H = |p|²/2 − 1/|q|, e = 0.6, to t = 50; the answers that its repository stores "
        "for the example ark_kepler (its source is in the file).",
        "Where a method here has the same coefficients, it is run with the same step.",
    ),
    runs=(Runs(THEIRS, both, over(file=sorted(p.name for p in FOLDER.glob("*.csv"))), needs, more=(OURS,)),),
    claims={
        "same": Claim(
            "Methods of this suite with the same coefficients have the same energy errors",
            THEIRS, lambda rows: apart(rows) <= SAME, rows="twin_energy_error == twin_energy_error", unit="rows",
            where=farthest, checked=True,
        ),
    },
    checks={
        "ends": Claim(
            "Every method here reaches an end",
            OURS, lambda rows: (rows["status"] == OK).groupby(rows["method"]).any(),
        ),
    },
    numbers={"rows": Number(THEIRS, len), "packages": packages},
    figure=draw,
    shown=table,
    whole=of(THEIRS)(lambda rows: rows.drop(columns=["file", "made_on", "source", "reason"])),
    limits=(
        f"Two energy errors are the same within {SAME:g}, the round-off of some thousand steps: of larger errors that "
        "is many digits, of the smallest it is none.",
        "SUNDIALS ends at t = 50 exactly with a shortened step, if n steps of h in doubles do not: that step is below "
        "1e-10.",
        "An energy error at one time depends on where on the orbit it is: the same method can have less at a longer "
        "step.",
        f"Rows with more than {MOST} evaluations are in the table of data alone.",
    ),
)  # fmt: skip
