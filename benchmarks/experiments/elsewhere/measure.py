"""Compare results from other machines with this suite's methods: errors at the same number of evaluations, never times.

A file holds rows (method, step or tolerance, evaluations, end state or energy error) that another package produced on
another machine.  The errors of its end states are computed here, against the certified reference (stored states with a
bound of their error).  Methods of this suite are run on the same problem with as many evaluations as each of the rows
took, or fewer.  If a method in the file has the same coefficients as a method here (`TWINS`), the latter is run with
the same step: the energy errors of both have to agree, which tests the file and this suite.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.store import elsewhere
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content, states
from phasebench.benchmarks.store.elsewhere import Elsewhere
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import method

FOLDER = Path(__file__).parent
#: The modules with which rows are computed.
CODE = (__name__, "phasebench.benchmarks.store.elsewhere")
THEIRS, OURS = "elsewhere", "elsewhere_own"
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
#: Largest number of evaluations of a run here, of runs of a method, and of tries to stay within as many evaluations.
MOST, RUNS, TRIES = 400_000, 12, 40
#: Least share of a budget of evaluations that a run takes: with fewer it is not compared.
USED = 0.5
#: Largest factor between the numbers of steps of two tries.
SHORTEN = 1.25


def compare(file: Elsewhere, methods: Sequence[str] | None = None) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Compute the errors of a file's rows, and run this suite's methods with about as many evaluations as these took.

    Returns (the file's rows with errors and, where a method here has the same coefficients, the energy error of that
    method; the rows of this suite's methods).  ``methods`` are by default those of `METHODS` that can integrate the
    problem.

    Raises
    ------
    InvalidInput
        If a given method is unknown, cannot integrate the problem, or takes no fixed step.
    """
    theirs = [row | _twin(file, row) for row in elsewhere.errors(file)]
    budgets = sorted({row["evaluations"] for row in theirs if row["evaluations"] <= MOST})
    budgets = budgets[:: max(1, -(-len(budgets) // RUNS))]
    ours = []
    for name in METHODS if methods is None else methods:
        chosen = integrator(name)
        lack = chosen.lacks(file.problem)
        if lack and methods is None:
            continue
        if lack or chosen.adaptive:
            raise InvalidInput(f"'{name}' cannot be compared: {lack or 'it takes no fixed step'}")
        ours += _ladder(file, chosen, budgets)
    return theirs, ours


def _ladder(file: Elsewhere, chosen: Integrator, budgets: Sequence[int]) -> list[dict[str, Any]]:
    """Run a method with as many steps as each budget of evaluations allows: a row for each run.

    ``file`` has another package's results on a problem; the runs are on the same problem and span.  A run that takes
    less than the share `USED` of its budget is left out.
    """
    rows: dict[int, dict[str, Any]] = {}
    price = 1.0
    for budget in sorted(budgets, reverse=True):
        steps = int(budget / price)
        for _ in range(TRIES):
            if steps < 1:
                break
            row = _run(file, chosen, steps)
            share = row["evaluations"] / budget
            if share <= 1:
                if share >= USED:
                    price = row["evaluations"] / steps
                    rows[steps] = {"file": file.path.name, "method": chosen.id} | row
                break
            # An implicit method's steps become dearer as they become longer.
            steps = min(steps - 1, int(steps / min(share, SHORTEN)))
    return [rows[steps] | _errors(file, rows[steps]) for steps in sorted(rows)]


def _run(file: Elsewhere, chosen: Integrator, steps: int) -> dict[str, Any]:
    """Run a method in ``steps`` steps on the problem and over the span of a file of results.

    Returns a dict: the step, the evaluations, the status, and the states ``q`` and ``p`` at the start and the end.
    """
    h = file.t_end / steps
    s = chosen.run(file.problem, h=h, steps=steps, save_every=0)
    out = {"h": h, "steps": steps, "evaluations": s.counts["gradient"], "status": s.status, "reason": s.reason}
    return out | {"q": s.q, "p": s.p}


def _errors(file: Elsewhere, row: dict[str, Any]) -> dict[str, Any]:
    """Compute the energy error and the error of the end state of a run ``row``, a dict made by `_run`.

    Removes the states "q" and "p" from ``row``; the errors are None if the run failed.
    """
    q, p = row.pop("q"), row.pop("p")
    if row["status"] != "ok":
        return {"energy_error": None, "error": None, "uncertainty": None}
    start, end = file.problem.system.observe(file.problem.system.H, q[[0, -1]], p[[0, -1]])
    return {"energy_error": float(end - start)} | elsewhere.state_error(file.problem, file.t_end, q[-1], p[-1])


def _twin(file: Elsewhere, row: dict[str, Any]) -> dict[str, Any]:
    """Run the method of this suite that has the same coefficients as a row's method, with the same step.

    Returns its id and its energy error, as "twin" and "twin_energy_error"; None where there is no such method or run.
    """
    twin = TWINS.get((row["package"], row["method"]))
    if twin is None or row["h"] is None or row["evaluations"] > MOST:
        return {"twin": twin, "twin_energy_error": None}
    steps = round(file.t_end / row["h"])
    if abs(steps * row["h"] / file.t_end - 1) > elsewhere.SAME:
        return {"twin": twin, "twin_energy_error": None}
    return {"twin": twin, "twin_energy_error": _errors(file, _run(file, integrator(twin), steps))["energy_error"]}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each file of results in this folder; none if ``quick``."""
    return [] if quick else [_cell(path) for path in sorted(FOLDER.glob("*.csv"))]


def _cell(path: Path) -> Cell:
    name, parameters, package = elsewhere.problem_key(path)
    used = dict.fromkeys([*METHODS, *(twin for (of, _), twin in TWINS.items() if of == package)])
    key = ProblemKey(name, tuple(parameters.items()))
    return Cell(
        "elsewhere",
        (THEIRS, OURS),
        {"file": path.name},
        measure_rows,
        (path.name,),
        content(path.read_text(encoding="utf-8"), key, states(key.id), *map(method, used), code=CODE),
        frozenset({"elsewhere", package, key.id}),
    )


def measure_rows(name: str) -> Rows:
    """Make the rows of a results file in this folder, and those of this suite's methods, by table name."""
    theirs, ours = compare(elsewhere.read(FOLDER / name))
    return {THEIRS: theirs, OURS: ours}
