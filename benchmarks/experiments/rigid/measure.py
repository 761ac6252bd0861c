r"""Methods for a rigid body beside ordinary ones, which integrate its quaternion.

- **Attitude**: the angle in degrees between the attitude at the end of `SPAN` and the certified one, for falling steps,
  with the order from the two shortest whose errors are above round-off; what is kept of :math:`R^T R = 1` and of the
  momentum in space.
- **Symmetry**: on free bodies with the moments :math:`(1, 1 + \delta, 2)`, the errors of two splittings at one step:
  `rigid-dlm`, turns about the principal axes, and `rigid-reich`, the exact flow of a symmetric top between turns.
- **Energy**: the spread of the energy over a million steps on a top that is chaotic, and over the first tenth of them.

The angle of the turn from one attitude q to another r is :math:`4\arcsin(\min|q \pm r| / 2)`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.integrators.systems.rigid import RigidBody
from phasebench.reference.solvers.taylor import reference

ATTITUDE, SYMMETRY, ENERGY = "rigid_attitude", "rigid_symmetry", "rigid_energy"
FREE, TOP = "free-rigid-body:tumbling", "heavy-top:nutating"
PROBLEMS = (FREE, TOP)
BODIES = tuple(m.id for m in METHODS if m.family == "rigid")
ORDINARY = ("rk4", "implicit-midpoint", "gauss-4")
SPAN, STEPS = 100.0, tuple(500 * 2**k for k in range(6))
#: Angles above this, in degrees, are errors of the method and not of rounding.
ROUNDING = 1e-9
#: Asymmetries, the step and the span of their runs, and the state.
DELTAS, H, SHORT = tuple(4.0**-k for k in range(1, 8)), 0.05, 20.0
START = {"attitude": (0.8, 0.48, 0.0, -0.36), "momentum": (0.4, 0.9, -0.6)}
#: The top that is chaotic, the step and the number of steps of its runs.
CHAOTIC, LONG_H, LONG = {"I2": 1.3, "x1": 0.5}, 0.1, 1_000_000
CODE = (__name__,)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): attitudes, nearly symmetric bodies and long runs; none if ``quick``."""
    if quick:
        return []
    runs = [
        _cell(ATTITUDE, {"method": id, "problem": name}, attitude, (id, name), BY_ID[id], ProblemKey(name))
        for name in PROBLEMS
        for id in (*BODIES, *ORDINARY)
    ]
    splittings = BY_ID["rigid-dlm"], BY_ID["rigid-reich"]
    near = [_cell(SYMMETRY, {"delta": delta}, symmetry, (delta,), *splittings) for delta in DELTAS]
    top = ProblemKey("heavy-top", tuple(sorted(CHAOTIC.items())))
    second = [BY_ID[id] for id in BODIES if BY_ID[id].order == 2]
    long = [_cell(ENERGY, {"method": m.id}, energy, (m.id,), m, top) for m in second]
    return runs + near + long


def _cell(table: str, key: dict, measure: Callable, arguments: tuple, *needed: object) -> Cell:
    return Cell("rigid", (table,), key, measure, arguments, content(table, *arguments, *needed, code=CODE))


def angle(q: np.ndarray, r: np.ndarray) -> float:
    """Return the angle in degrees of the turn between two attitudes q and r, quaternions (4,) of any length."""
    q, r = q / np.linalg.norm(q), r / np.linalg.norm(r)
    nearest = min(np.linalg.norm(q - r), np.linalg.norm(q + r))
    return float(np.degrees(4 * np.arcsin(min(1.0, nearest / 2))))


def attitude(id: str, name: str) -> Rows:
    """Measure the errors of the method ``id`` on the problem ``name``: a row for each step size, by table name.

    A row has the attitude's error in degrees with the reference's uncertainty and the observed order, the changes of
    |q|^2 (named orthogonality), of a free body's momentum in space and of the energy, and evaluations a step.
    """
    problem = problem_of(name)
    truth = reference(problem, [SPAN])
    rows = []
    for steps in STEPS:
        s = integrate(problem, id, h=SPAN / steps, steps=steps, save_every=steps // 100)
        body: RigidBody = problem.system
        R, L = body.matrix(s.q), body.momentum(s.q, s.p)
        in_space = np.einsum("nij,nj->ni", R, L)
        known = s.invariants()
        row = {
            "method": id,
            "problem": name,
            "bodies": id in BODIES,
            "status": s.status,
            "h": SPAN / steps,
            "degrees": angle(s.q[-1], truth.q[-1]),
            "uncertainty": float(np.degrees(2 * truth.uncertainty[-1])),
            "orthogonality": float(np.abs(known["length"] - known["length"][0]).max()),
            "momentum": float(np.abs(in_space - in_space[0]).max()) if name == FREE else np.nan,
            "energy": float(np.abs(s.energy() - s.energy()[0]).max()),
            "evaluations": s.counts["gradient"] / steps,
            "declared": BY_ID[id].order,
        }
        rows.append(row)
    for row, order in zip(rows, successive([r["degrees"] for r in rows], [ROUNDING] * len(rows)), strict=True):
        row["order"] = order
    return {ATTITUDE: rows}


def symmetry(delta: float) -> Rows:
    """Measure the errors of two splittings on a free body with the moments (1, 1 + delta, 2): one row, by table name.

    The errors are the angles in degrees from the true attitude at the end: column ``axes`` for `rigid-dlm`, which turns
    about the principal axes, and ``top`` for `rigid-reich`, which splits off a symmetric top.
    """
    body = RigidBody(moments=(1, 1 + delta, 2))
    q, p = body.start(**START)
    steps = round(SHORT / H)

    def end(id: str, n: int) -> np.ndarray:
        return integrate(body, id, h=SHORT / n, steps=n, q0=q, p0=p, save_every=0).q[-1]

    exact, finer = end("gauss-8", steps), end("gauss-8", 2 * steps)
    axes, top = (angle(end(id, steps), finer) for id in ("rigid-dlm", "rigid-reich"))
    return {SYMMETRY: [{"delta": delta, "axes": axes, "top": top, "uncertainty": angle(exact, finer)}]}


def energy(id: str) -> Rows:
    """Measure the spread (largest less smallest value) of the energy on a chaotic top: one row, by table name.

    It is measured over all steps of the method ``id`` (``all``) and over the first tenth of them (``first``).
    """
    top = problem_of("heavy-top", **CHAOTIC)
    s = integrate(top, id, h=LONG_H, steps=LONG, save_every=LONG // 10_000)
    values = s.energy()
    row = {"method": id, "symplectic": BY_ID[id].symplectic, "status": s.status, "steps": LONG, "h": LONG_H}
    return {ENERGY: [row | {"first": float(np.ptp(values[: len(values) // 10])), "all": float(np.ptp(values))}]}
