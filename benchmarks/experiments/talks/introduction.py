"""The statements of the introductory talk, "Symplectic Integration of Hamiltonian Systems", in the talk's order.

Each has a judge: a function of the measured tables (table name -> rows) that returns a `Judgement`, whether the
statement holds and the numbers that show it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.benchmarks.store.arrays import unpack

from .checks_base import TABLE as CHECKS
from .judging import NOTHING, check, curves, every, has, judgement, on_rows, order, rows_of, system, untestable, where
from .record import TABLE as CURVES
from .statement import DEFINITION, FIGURE, FORMULA, METHOD, REMARK, SYSTEM, THEOREM, Statement

if TYPE_CHECKING:
    import pandas as pd

    from phasebench.benchmarks.page.page import Data

    from .judging import Judge, Judgement

MAPS, LV = "talk-symplectic-maps", "talk-lotka-volterra"
EULERS = ("symplectic-euler-p", "symplectic-euler-q")
KEPT = 1e-11


def areas(kept: tuple[str, ...], lost: tuple[str, ...]) -> Judge:
    """Make a judge of whether maps keep the area of a set in the pendulum's phase plane.

    The maps named in ``kept`` must keep it to round-off, those in ``lost`` must not.
    """

    def judge(data: Data) -> Judgement:
        rows = rows_of(data, CURVES, figure="pendulum-area")
        if rows.empty or not {*kept, *lost} <= set(rows["panel"]):
            return NOTHING
        change = rows.dropna(subset=["area"]).groupby("panel")["area"].agg(lambda a: (a - a.iloc[0]).abs().max())
        good = change[list(kept)].max() <= KEPT and change[list(lost)].min() > KEPT
        text = f"change of area up to {change[list(kept)].max():.1e}; {lost[0]} {change[list(lost)].min():.1e}"
        return judgement(bool(good), text)

    return judge


@on_rows(CURVES, figure="lotka-volterra-flow")
def disc(rows: pd.DataFrame) -> Judgement:
    """Judge from measured rows whether the exact flow of Lotka-Volterra keeps the measure du dv / (u v) of a disc."""
    change = (rows["measure"] - rows["measure"].iloc[0]).abs().max()
    area = rows["area"].max() - rows["area"].min()
    text = f"∫ du dv/(uv) of a carried disc changes by {change:.1e}, its area by {area:.2f}"
    return judgement(bool(change <= KEPT), text)


def parallelogram(data: Data) -> Judgement:
    """Judge whether a midpoint step keeps omega(xi, eta) on coupled oscillators, and an explicit Euler step does not.

    omega is the symplectic form, xi and eta two vectors; ``data`` maps a table's name to its rows.
    """
    from .linear_map import areas as oriented

    rows = rows_of(data, CURVES, figure="linear-symplectic-map")
    if len(rows) < 3:
        return NOTHING
    first, middle, euler = (oriented(unpack(r.x), unpack(r.y)).sum() for r in rows.itertuples())
    good = abs(middle - first) <= KEPT < abs(euler - first)
    text = f"change of ω: midpoint {abs(middle - first):.1e}, explicit Euler {abs(euler - first):.2f}"
    return judgement(bool(good), text)


@on_rows(CHECKS, check="species")
def prey(rows: pd.DataFrame) -> Judgement:
    """Judge from measured rows whether u is the prey and v the predator in the Lotka-Volterra equations.

    The growth rate of u must fall if v grows, and that of v rise if u grows.
    """
    r = rows.iloc[0]
    return judgement(r["value"] < 0 < r["control"], f"{r['what']}: {r['value']:+g}; {r['against']}: {r['control']:+g}")


def _lotka_volterra(name: str, bound: float, above: bool = False) -> Judge:
    return curves("lotka-volterra-methods", "energy_error", bound, panel=name, above=above)


MAPS_AND_METHODS: tuple[Statement, ...] = (
    Statement("Background", REMARK, "geometry of the flow should be kept by methods",
              untestable("an aim, no statement"), "structure"),
    Statement("Background", SYSTEM, "Kepler problem", system("kepler"), "kepler"),
    Statement("Background", SYSTEM, "outer solar system", system("outer-solar-system"), "matrix"),
    Statement("Background", SYSTEM, "highly oscillatory problem", system("fpu"), "oscillatory"),
    Statement("The pendulum", SYSTEM, "H = p²/2 − cos q gives p' = −sin q, q' = p", check("pendulum", 1e-14), MAPS),
    Statement("Area preservation", FIGURE, "the pendulum's flow carries sets without changing their area",
              areas(("exact flow",), ("explicit Euler",)), MAPS),
    Statement("Theorem 1", THEOREM, "Lagrange's and Hamilton's equations are equivalent", check("lagrange", 1e-13),
              "problems"),
    Statement("Properties, 1", THEOREM, "H is a first integral", check("first-integral", 1e-12), "invariants"),
    Statement("Oriented area", FORMULA, "ω is the sum of oriented areas, ξᵀJη", check("oriented-areas", 1e-14), MAPS),
    Statement("Definition 2.1", DEFINITION, "A is symplectic iff AᵀJA = J, iff it keeps ω", check("linear-maps", 1e-13),
              "structure"),
    Statement("Fig. 2.1", FIGURE, "a symplectic linear map keeps the sum of projected areas", parallelogram, MAPS),
    Statement("Definition 2.2", DEFINITION, "nonlinear symplectic maps keep areas",
              areas(("symplectic Euler", "implicit midpoint"), ("explicit Euler",)), MAPS),
    Statement("Flow", DEFINITION, "the flow takes initial values to those at t", check("group", 1e-12), "references"),
    Statement("Theorem 2.3", THEOREM, "Poincaré: the flow of a Hamiltonian system is symplectic",
              check("poincare", 1e-10), MAPS),
    Statement("Theorem 2.4", THEOREM, "a flow is symplectic iff its field is locally Hamiltonian",
              check("locally-hamiltonian", 1e-10), MAPS),
    Statement("Lemma 2.5", THEOREM, "a field with a symmetric Jacobian is a gradient", check("integrability", 1e-13),
              "structure"),
    Statement("Definition 3.1", DEFINITION, "a method is symplectic if its step map always is",
              every(has((*EULERS, "implicit-midpoint"), "symplecticity"), has(("rk4",), "symplecticity", False)),
              "structure"),
    Statement("Theorem 3.1", THEOREM, "both symplectic Euler methods are symplectic and of order 1",
              every(has(EULERS, "symplecticity"), order(EULERS, 1)), "orders"),
    Statement("Theorem 3.2", THEOREM, "the implicit midpoint rule is symplectic and of order 2",
              every(has(("implicit-midpoint",), "symplecticity"), order(("implicit-midpoint",), 2)), "orders"),
)  # fmt: skip

LOTKA_VOLTERRA: tuple[Statement, ...] = (
    Statement("Lotka–Volterra", SYSTEM, "u' = u(v − 2), v' = v(1 − u)", check("lotka-volterra", 1e-14), "problems"),
    Statement("Invariants", FORMULA, "I = ln u − u + 2 ln v − v is kept", check("level-curves", 1e-13), LV),
    Statement("Fig. 4.1", FIGURE, "the exact flow goes round on level curves of I", disc, LV),
    Statement("Fig. 4.1, names", REMARK, "u are the prey, v the predators (the model said the reverse)",
              prey, LV),
    Statement("Explicit Euler", METHOD, "the simplest method, of order 1", order(("explicit-euler",), 1), "orders"),
    Statement("Implicit Euler", METHOD, "damps everything", check("damps", 1 - 1e-3), LV),
    Statement("Implicit midpoint", METHOD, "is symmetric", has(("implicit-midpoint",), "symmetry"), "structure"),
    Statement("Symplectic Euler", METHOD, "applies to partitioned systems, one variable implicit",
              order(("symplectic-euler-q",), 1, "lotka-volterra"), LV),
    Statement("Numerical flow", FIGURE, "Euler methods from (2, 2) and (4, 8), h = 0.12, leave the level curve",
              every(_lotka_volterra("explicit Euler", 2, True), _lotka_volterra("implicit Euler", 2, True)), LV),
    Statement("Numerical flow", FIGURE, "midpoint from (4, 2) and (2, 2), h = 0.12, stays near the level curve",
              _lotka_volterra("implicit midpoint", 0.05), LV),
    Statement("Numerical flow", FIGURE, "symplectic Euler from (4, 2) and (6, 2), h = 0.12, stays in a band",
              _lotka_volterra("symplectic Euler", 2), LV),
    Statement("Results, 1", REMARK, "explicit and implicit Euler are qualitatively wrong",
              every(_lotka_volterra("explicit Euler", 2, True), _lotka_volterra("implicit Euler", 2, True)), LV),
    Statement("Results, 2", REMARK, "midpoint orbits seem to lie on a closed curve",
              where(_lotka_volterra("implicit midpoint", 0.05), check("closed-midpoint", 0.01),
                    "over the talk's 120 steps"), LV),
    Statement("Results, 3", REMARK, "symplectic Euler orbits seem to lie on a closed curve",
              check("closed-euler", 0.01), LV),
)  # fmt: skip
