r"""Measure the local conservation laws of box schemes for wave equations in space-time, with period 2 pi in space.

Smooth data of few modes: for the nonlinear Schroedinger equation :math:`\psi = 1 + 0.4\cos x + 0.2i\sin x`, for the
Klein-Gordon equation :math:`\phi = 1 + 0.5\cos x + 0.3i\sin x`,
:math:`\phi_t = 0.2\sin x + i(0.5 + 0.2\cos x)`; the tangents have the first two modes.  Decreasing steps on the
coarsest mesh show the order in time, finer meshes at one step the order in space.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from phasebench.benchmarks.problems import klein_gordon, nls
from phasebench.benchmarks.store.cells import Cell, Rows, content
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families.multisymplectic import Scheme, run, scheme, schemes
from phasebench.integrators.systems.multisymplectic import Equation

from . import laws

TABLE = "multisymplectic"
#: Numbers of mesh cells for the order in space; the first is used for the order in time.
CELLS = (17, 25, 33, 49, 65)
#: Number of halvings of the longest step; length of the integrations in longest steps.
HALVINGS, LONG = 3, 10
#: Number of steps of the runs over `CELLS`.
FEW = 4
IN_TIME, IN_SPACE = "time", "space"


@dataclass(frozen=True)
class Case:
    """A wave equation with its initial values, tangents, invariant and longest steps.

    Attributes
    ----------
    name : name of the equation
    equation : its multisymplectic form
    data : function x -> (y, u, v), arrays (N, m): initial values and two tangents (data of the linearized equation)
    invariant : function y -> the quadratic invariant, a sum over the mesh cells
    longest : largest step of the runs
    longest_euler : largest step of the Euler box scheme, whose stability limits it
    """

    name: str
    equation: Equation
    data: Callable
    invariant: Callable
    longest: float
    longest_euler: float


def _schroedinger(x: np.ndarray) -> Iterator[np.ndarray]:
    one, c, s = np.ones_like(x), np.cos(x), np.sin(x)
    return (np.stack(columns, axis=1) for columns in ((1 + 0.4 * c, 0.2 * s), (c, np.sin(2 * x)), (s, one)))


def _klein_gordon(x: np.ndarray) -> Iterator[np.ndarray]:
    one, c, s = np.ones_like(x), np.cos(x), np.sin(x)
    start = (1 + 0.5 * c, 0.3 * s, 0.2 * s, 0.5 + 0.2 * c)
    tangents = (c, np.sin(2 * x), one, s), (s, one, np.cos(2 * x), c)
    return (np.stack(columns, axis=1) for columns in (start, *tangents))


def mass(y: np.ndarray) -> float:
    """Return the mass of the nonlinear Schroedinger equation, the sum of |psi|^2; y = (Re, Im) of psi, array (N, 2)."""
    return float((y**2).sum())


def charge(y: np.ndarray) -> float:
    """Return the charge of the Klein-Gordon equation, the sum of q1 p2 - q2 p1; y = (q1, q2, p1, p2), array (N, 4)."""
    return float((y[:, 0] * y[:, 3] - y[:, 1] * y[:, 2]).sum())


CASES = {
    c.name: c
    for c in (
        Case("nls", nls.multisymplectic(), _schroedinger, mass, 0.03, 0.004),
        Case("klein-gordon", klein_gordon.multisymplectic(), _klein_gordon, charge, 0.08, 0.08),
    )
}


def ladder(case: Case, chosen: Scheme) -> list[tuple[str, int, float, int]]:
    """List the runs of a box scheme on an equation: (what gets finer, number N of mesh cells, h, number of steps).

    First the step h falls on one mesh (`IN_TIME`), then the mesh gets finer at one h (`IN_SPACE`).
    """
    h = case.longest_euler if chosen.id == "euler-box" else case.longest
    in_time = [(IN_TIME, CELLS[0], h / 2**k, LONG * 2**k) for k in range(HALVINGS + 1)]
    return in_time + [(IN_SPACE, N, h / 2**HALVINGS, FEW) for N in CELLS]


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each equation, box scheme, step and mesh; none if ``quick``."""
    if quick:
        return []
    return [_cell(c, s, *rung) for c in CASES.values() for s in schemes().values() for rung in ladder(c, s)]


def _cell(case: Case, chosen: Scheme, falls: str, N: int, h: float, steps: int) -> Cell:
    key = {"equation": case.name, "id": chosen.id, "falls": falls, "N": N, "h": h}
    parts = [case.name, chosen.id, falls, N, h, steps, *map(str, (chosen.A_q, chosen.A_p, chosen.b, chosen.S))]
    module = "phasebench.benchmarks.problems.{}".format(case.name.replace("-", "_"))
    about = content("multisymplectic", *parts, code=[__name__, module])
    arguments = (case.name, chosen.id, falls, N, h, steps)
    return Cell("waves", (TABLE,), key, measure_rows, arguments, about, frozenset({case.name, chosen.id, TABLE}))


def measure_rows(name: str, id: str, falls: str, N: int, h: float, steps: int) -> Rows:
    """Run the box scheme ``id`` on the equation ``name`` with N mesh cells and step h; measure its conservation laws.

    ``falls`` says what gets finer along a series of such rows: "time" for the step, "space" for the mesh.  Returns
    {`TABLE`: [row]}.
    """
    case, chosen = CASES[name], scheme(id)
    row = {"equation": name, "id": id, "scheme": chosen.name, "falls": falls, "N": N, "h": h, "steps": steps}
    row |= {"order": chosen.order, "multisymplectic": chosen.multisymplectic, "keeps": chosen.keeps}
    dx = 2 * np.pi / N
    y, *tangents = case.data(dx * np.arange(N))
    space = chosen.division(case.equation, N, dx)
    try:
        found = laws.measure(space, chosen, run(case.equation, chosen, y, dx, h, steps, tangents), h, case.invariant)
    except (ArithmeticError, InvalidInput) as error:
        return {TABLE: [row | {"status": "not-converged", "reason": str(error)}]}
    return {TABLE: [row | {"status": "ok", "reason": ""} | found]}
