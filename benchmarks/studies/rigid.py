r"""Methods for a rigid body beside ordinary ones, which integrate its quaternion.

The angle of the turn from one attitude q to another r is :math:`4\arcsin(\min|q \pm r| / 2)`.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.shared import growth, order_off
from phasebench.benchmarks.page.study import Claim, Curves, Number, Runs, Shown, Study, over
from phasebench.benchmarks.page.verdict import Between, at_least, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.integrators.systems.rigid import RigidBody
from phasebench.reference.solvers.taylor import reference

ATTITUDE, SYMMETRY, ENERGY = "rigid_attitude", "rigid_symmetry", "rigid_energy"
FREE, TOP = "free-rigid-body:tumbling", "heavy-top:nutating"
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


def angle(q: np.ndarray, r: np.ndarray) -> float:
    """The angle in degrees of the turn between two attitudes q and r, quaternions (4,) of any length."""
    q, r = q / np.linalg.norm(q), r / np.linalg.norm(r)
    nearest = min(np.linalg.norm(q - r), np.linalg.norm(q + r))
    return float(np.degrees(4 * np.arcsin(min(1.0, nearest / 2))))


def attitude(method: str, problem: str) -> list[dict]:
    """The attitude's error for falling steps, with the order, and what is kept: a row for each step."""
    made, rows = problem_of(problem), []
    truth = reference(made, [SPAN])
    for steps in STEPS:
        s = integrate(made, method, h=SPAN / steps, steps=steps, save_every=steps // 100)
        body: RigidBody = made.system
        in_space = np.einsum("nij,nj->ni", body.matrix(s.q), body.momentum(s.q, s.p))
        length = s.invariants()["length"]
        row = {
            "bodies": method in BODIES,
            "status": s.status,
            "h": SPAN / steps,
            "degrees": angle(s.q[-1], truth.q[-1]),
            "uncertainty": float(np.degrees(2 * truth.uncertainty[-1])),
            "orthogonality": float(np.abs(length - length[0]).max()),
            "momentum": float(np.abs(in_space - in_space[0]).max()) if problem == FREE else np.nan,
            "energy": float(np.abs(s.energy() - s.energy()[0]).max()),
            "evaluations": s.counts["gradient"] / steps,
            "declared": BY_ID[method].order,
        }
        rows.append(row)
    orders = successive([r["degrees"] for r in rows], [ROUNDING] * len(rows))
    return [row | {"order": order} for row, order in zip(rows, orders, strict=True)]


def symmetry(delta: float) -> dict:
    """The errors of two splittings on a free body with the moments (1, 1 + delta, 2), in degrees.

    Column ``axes`` is of `rigid-dlm`, turns about the principal axes; ``top`` of `rigid-reich`, which splits off the
    exact flow of a symmetric top.
    """
    body = RigidBody(moments=(1, 1 + delta, 2))
    q, p = body.start(**START)
    steps = round(SHORT / H)

    def end(id: str, n: int) -> np.ndarray:
        return integrate(body, id, h=SHORT / n, steps=n, q0=q, p0=p, save_every=0).q[-1]

    exact, finer = end("gauss-8", steps), end("gauss-8", 2 * steps)
    axes, top = (angle(end(id, steps), finer) for id in ("rigid-dlm", "rigid-reich"))
    return {"axes": axes, "top": top, "uncertainty": angle(exact, finer)}


def energy(method: str) -> dict:
    """The spread of the energy on a chaotic top over a long run (``all``), and over its first tenth (``first``)."""
    s = integrate(problem_of("heavy-top", **CHAOTIC), method, h=LONG_H, steps=LONG, save_every=LONG // 10_000)
    values = s.energy()
    about = {"symplectic": BY_ID[method].symplectic, "status": s.status, "steps": LONG, "h": LONG_H}
    return about | {"first": float(np.ptp(values[: len(values) // 10])), "all": float(np.ptp(values))}


def gain(rows: pd.DataFrame) -> float | None:
    """The power of 1 / delta with which the symmetric top's splitting gains; None for fewer than three bodies."""
    if len(rows) < 3:
        return None
    return -np.polyfit(np.log(rows["delta"]), np.log(rows["axes"] / rows["top"]), 1)[0]


def deltas(rows: pd.DataFrame) -> str:
    """The bodies that were measured, in words."""
    low, high = number(rows["delta"].min()), number(rows["delta"].max())
    return f"moments 1, 1 + delta, 2, delta = {low} to {high}"


FIRST = "times the spread over the first tenth"
STUDY = Study(
    id="rigid",
    place=290,
    question="What do methods for rigid bodies keep, and does a chaotic top's energy stay bounded?",
    answer="Rotations are kept to {kept}; on a chaotic top the energy's spread grows at most {symplectic} times with "
    "symplectic methods, {others} times with the Lie midpoint.",
    setting=(
        "A body about a fixed point, its attitude a quaternion q with momenta p: H = sum of L_k²/2I_k + V, canonical "
        "in eight variables.",
        f"A free body that turns over again and again ({FREE}) and a heavy top ({TOP}), with certified states.",
        "Ordinary methods run on the same eight equations.",
        f"Long runs: {LONG} steps of h = {LONG_H} on the heavy top with I2 = 1.3 and its centre of mass off the axis.",
    ),
    runs=(
        Runs(ATTITUDE, attitude, over(method=(*BODIES, *ORDINARY), problem=(FREE, TOP))),
        Runs(SYMMETRY, symmetry, over(delta=DELTAS), needs=(BY_ID["rigid-dlm"], BY_ID["rigid-reich"])),
        Runs(ENERGY, energy, over(method=[id for id in BODIES if BY_ID[id].order == 2]),
             needs=(ProblemKey("heavy-top", tuple(sorted(CHAOTIC.items()))),)),
    ),
    claims={
        "kept": Claim(
            "Methods for rigid bodies keep rotations orthogonal, and a free body's momentum in space",
            ATTITUDE, lambda rows: rows[["orthogonality", "momentum"]].max(axis=1), at_most(1e-13), rows="bodies",
            fault=True,
        ),
        "left": Claim(
            "The fourth-order Runge-Kutta method on the quaternion leaves the rotations",
            ATTITUDE, "orthogonality", at_least(1e-9), rows=f"method == 'rk4' and h == {SPAN / STEPS[0]}",
            where="{problem}", fault=True,
        ),
        "orders": Claim(
            "Attitudes converge with the declared order",
            ATTITUDE, order_off, at_most(0.15), rows="bodies", unit="from the declared order", fault=True,
        ),
        "gain": Claim(
            "The gain of splitting off a symmetric top is inverse to the body's asymmetry",
            SYMMETRY, gain, Between(0.9, 1.1), unit="as the power", where=deltas, checked=True,
        ),
        "bounded": Claim(
            "Symplectic or not, every method keeps a chaotic top's energy bounded",
            ENERGY, growth, at_most(2.0), unit=FIRST, where="{method}, {steps:.0f} steps",
        ),
    },
    numbers={"symplectic": Number(ENERGY, growth, "symplectic"), "others": Number(ENERGY, growth, "not symplectic")},
    figure=(
        Curves(ATTITUDE, "h", "degrees", "step h", "attitude error in degrees",
               rows=f"bodies and problem == '{TOP}'", title=TOP),
        Curves(SYMMETRY, "delta", {"axes": "rigid-dlm", "top": "rigid-reich"}, "asymmetry delta",
               "attitude error in degrees", title="moments 1, 1 + delta, 2"),
    ),
    title="attitude errors",
    caption=f"Left: the angle between the attitude at t = {SPAN:g} and the certified one. Right: both splittings of "
    "order 2 at one step, on free bodies that are nearly symmetric.",
    shown=Shown(
        ATTITUDE,
        ("problem", "method", "degrees", "uncertainty", "orthogonality", "momentum", "energy", "evaluations"),
        "At h = 0.05: the attitude's error in degrees with the reference's uncertainty, the largest change of |q|² "
        "(orthogonality: RᵀR changes with it), of a free body's momentum in space and of the energy, and evaluations "
        "of the torque a step.",
        rows="abs(h - 0.05) < 1e-9",
    ),
    limits=(
        "A step of `rigid-dlm` or `rigid-reich` costs one torque and a few sines; that of `moser-veselov` and "
        "`lie-midpoint` solves an equation of three unknowns besides. Times are in the trade.",
        "That the steps are those of rotation matrices, and that all but the Lie midpoint are symplectic, is measured "
        "in 30 digits by the tests.",
        "That the energy of a chaotic top stays bounded is seen over this many steps, not beyond.",
    ),
)  # fmt: skip
