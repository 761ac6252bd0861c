"""Statements of the talk "A general symplectic integrator for canonical Hamiltonian systems", in the talk's order.

Each has a judge: a function of the measured tables (table name -> rows) that returns a `Judgement`, whether the
statement holds and the numbers that show it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.benchmarks.page.markdown import number

from .judging import (
    CONTRADICTED,
    HOLDS,
    NOTHING,
    WHERE,
    Judgement,
    check,
    completed_runs,
    curves,
    every,
    has,
    judgement,
    keeps_energy,
    on_rows,
    order,
    printed_entries,
    rows_of,
    untestable,
    where,
)
from .statement import DEFINITION, FIGURE, FORMULA, METHOD, REMARK, SYSTEM, TABLE, THEOREM, Statement

if TYPE_CHECKING:
    import pandas as pd

    from phasebench.benchmarks.page.page import Data

    from .judging import Judge

ORDERS, STRUCTURE, HH, PK = "orders", "structure", "talk-henon-heiles", "talk-perturbed-kepler"
ENERGY, PRINTED, WAVES, BOXES = "energy_preservation", "printed", "waves", "multisymplectic"
KEPT = 1e-11
#: The schemes that choose λ anew in each step.
TUNED = ("scheme-iv", "scheme-v")
VALUES = ("-1", "1/3", "3/2")


def labels(id: str) -> tuple[str, ...]:
    """Return the labels, such as "scheme-i(lam=1/3)", of a method at each lambda for which its order is measured."""
    return tuple(f"{id}(lam={lam})" for lam in VALUES)


def _generating(order_: int) -> tuple[str, ...]:
    return tuple(f"generating-function(lam={lam}, order={order_})" for lam in VALUES)


def roots(*schemes: str, condition: str = "λ near 1/2 exists") -> Judge:
    """Make a judge (a function of measured tables) of whether schemes keep the energy by their choice of lambda.

    ``schemes`` are ids of methods that solve in each step for a parameter lambda with which H is kept.  The statement
    holds if every step has such a root and the energy is kept there to round-off; if some steps have none, it holds
    only under ``condition``, a text.
    """

    def judge(data: Data) -> Judgement:
        rows = rows_of(data, "energy_preservation", scheme=list(schemes), status="ok")
        waves = rows_of(data, "pde", method=list(schemes), status="ok")
        if rows.empty or waves.empty:
            return NOTHING
        missed, steps = int(rows["without a root"].sum()), int(rows["steps"].sum())
        lost, others = int(waves["fallbacks"].sum()), int((waves["t_end"] / waves["h"]).round().sum())
        worst = max(rows["energy error, steps with a root"].max(), waves["energy error"].max())
        text = f"no root on {missed} of {steps} steps, on {lost} of {others} of waves"
        text += f"; energy error {number(worst, 2)} on the others"
        if not worst <= KEPT:
            return Judgement(CONTRADICTED, text)
        return Judgement(WHERE if missed + lost else HOLDS, f"{condition}: {text}" if missed + lost else text)

    return judge


@on_rows("pde", method=list(TUNED), invariant="mass")
def nls_mass(rows: pd.DataFrame) -> Judgement:
    """Judge from measured rows whether Schemes IV and V keep the mass of the nonlinear Schroedinger equation.

    These schemes choose a parameter lambda in each step so that H is kept.
    """
    worst = rows["invariant error"].max()
    return judgement(worst <= KEPT, f"NLS mass changes by up to {number(worst, 2)}")


def charge(data: Data) -> Judgement:
    """Judge whether Schemes IV and V keep angular momentum and charge, invariants of the form q.D p.

    These schemes choose a parameter lambda in each step so that H is kept.  ``data`` maps a table's name to its rows.
    """
    rows = rows_of(data, "pde", method=list(TUNED), invariant="charge")
    turns = rows_of(data, "energy_preservation", scheme=list(TUNED), problem="perturbed-kepler")
    if rows.empty or turns.empty:
        return NOTHING
    worst = max(rows["invariant error"].max(), turns["angular momentum error"].max())
    return judgement(worst <= KEPT, f"q·Dp forms change by up to {number(worst, 2)}")


def box(column: str, bound: float) -> Judge:
    """Make a judge (a function of measured tables) of whether a residual or error of the EQUIP box scheme is small.

    The scheme, for wave equations, is a Gauss method in time with a parameter that keeps the total energy.  All values
    of the ``column`` in the table of box schemes must be at most ``bound``; for "two-form", the residual of the
    multisymplectic law, the bound is in units of round-off.
    """

    def judge(data: Data) -> Judgement:
        rows = rows_of(data, "multisymplectic", id="equip-box")
        if rows.empty or column not in rows:
            return NOTHING
        value = rows[column] / rows[f"{column}, round-off"] if column == "two-form" else rows[column]
        unit = " units of round-off" if column == "two-form" else ""
        text = f"{column} {'residual' if unit else 'at most'} {number(value.max(), 2)}{unit}"
        return judgement(value.max() <= bound, text)

    return judge


@on_rows("talk_curves", figure="perturbed-kepler-parameter", panel="lambda")
def middling(rows: pd.DataFrame) -> Judgement:
    """Judge from measured rows whether the median of the lambda that Schemes IV and V choose in a step is near 1/2.

    Schemes IV and V choose a parameter lambda in each step so that H is kept.
    """
    apart = (rows["median"] - 0.5).abs().max()
    text = f"|median of λ − 1/2| up to {number(apart, 2)}, range {number(rows['low'].min(), 2)} to "
    return judgement(apart < 0.1, f"{text}{number(rows['high'].max(), 2)}")


def exactly(scheme: str, order_: int) -> Judge:
    """Make a judge (a function of measured tables) of whether a scheme has exactly the order ``order_``."""
    return order((scheme,), order_)


FAMILIES = (
    ("generating functions", every(has(_generating(3), "symplecticity"), order(_generating(3), 3))),
    ("symplectic Runge–Kutta methods", every(has(("gauss-2",), "symplecticity"), order(("gauss-2",), 4))),
    ("composition methods", every(has(labels("scheme-iii-yoshida-4"), "symplecticity"),
                                  order(labels("scheme-iii-yoshida-4"), 4))),
    ("symplectic partitioned Runge–Kutta methods",
     every(has(("lobatto-iiia-iiib-3",), "symplecticity"), order(("lobatto-iiia-iiib-3",), 4))),
    ("variational integrators",
     every(has(("variational-gauss-2",), "symplecticity"), order(("variational-gauss-2",), 4))),
)  # fmt: skip
KEEPING = (
    ("projection methods", ("rk4-projected-energy", "stormer-verlet-symmetric-projection")),
    ("discrete gradients", ("gonzalez", "itoh-abe")),
    ("finite elements in time", ("cpg-2",)),
    ("averaged vector field", ("avf",)),
    ("Hamiltonian boundary value methods", ("hbvm-4-2",)),
    ("partitioned averaged vector field", ("pavf",)),
    ("EQUIP, Gauss based", ("gauss-equip-2",)),
)

SCHEMES: tuple[Statement, ...] = (
    Statement("(1)", FORMULA, "canonical systems, y' = J⁻¹∇H(y)", check("locally-hamiltonian", 1e-10), "problems"),
    Statement("(2)", THEOREM, "the flow keeps dp ∧ dq", check("poincare", 1e-10), "talk-symplectic-maps"),
    Statement("(3)", THEOREM, "the flow keeps H", check("first-integral", 1e-12), "invariants"),
    Statement("(4)–(5)", DEFINITION, "symplectic one-step methods",
              every(has(labels("scheme-i"), "symplecticity"), has(("rk4",), "symplecticity", False)), STRUCTURE),
    Statement("(6)", DEFINITION, "energy-preserving methods", keeps_energy(("avf",)), "matrix"),
    *(Statement("Symplectic methods", METHOD, name, judge, STRUCTURE) for name, judge in FAMILIES),
    *(Statement("Energy-preserving", METHOD, name, keeps_energy(ids), "matrix") for name, ids in KEEPING),
    Statement("Energy-preserving", METHOD, "EQUIP multi-symplectic methods",
              every(box("two-form", 10.0), box("total energy error", KEPT)), BOXES),
    Statement("(7)", METHOD, "symplectic Euler methods", order(("symplectic-euler-p", "symplectic-euler-q"), 1),
              ORDERS),
    Statement("(8)", METHOD, "implicit midpoint rule", order(("implicit-midpoint",), 2), ORDERS),
    Statement("Scheme I", METHOD, "λ = 0, 1, 1/2 are symplectic Euler and midpoint", check("special-values", 1e-14),
              STRUCTURE),
    Statement("Scheme I", REMARK, "is a one-stage symplectic partitioned Runge–Kutta method of order 1 at λ ≠ 1/2",
              order(labels("scheme-i"), 1), ORDERS),
    Statement("(9)–(10)", FORMULA, "the adjoint of λ is 1 − λ", check("adjoint", 1e-14), STRUCTURE),
    Statement("Theorem (Scheme I)", THEOREM, "Scheme I and its adjoint are symplectic for any λ",
              every(has((*labels("scheme-i"), *labels("scheme-i-adjoint")), "symplecticity"),
                    check("any-parameter", 1e-11)), STRUCTURE),
)  # fmt: skip

GENERATING: tuple[Statement, ...] = (
    *(Statement(f"λ = {lam}", FORMULA, f"Scheme I written out for λ = {lam}", check(f"form-{name}", 1e-14), HH)
      for lam, name in (("−1", "minus-one"), ("1/3", "third"), ("3/2", "three-halves"), ("2", "two"))),
    Statement("Nyström", FORMULA, "a one-stage Nyström method is Scheme I where T is quadratic",
              check("nystrom", 1e-14), ORDERS),
    Statement("Theorem (11)", THEOREM, "a map is symplectic iff the form in u, v is exact", check("exact-form", 1e-9),
              STRUCTURE),
    Statement("(12), Remark", REMARK, "λ = 0, 1, 1/2 give the three classical generating functions",
              check("special-values", 1e-14), STRUCTURE),
    Statement("Theorem (13)", THEOREM, "a solution S of the Hamilton–Jacobi equation generates the flow",
              check("hamilton-jacobi", 1e-8), STRUCTURE),
    Statement("(13), Remark", REMARK, "λ = 0, 1, 1/2 give the three classical equations",
              check("hamilton-jacobi", 1e-8), STRUCTURE),
    Statement("(14)–(17)", FORMULA, "K₁, K₂, K₃ of the power series", check("coefficients", 1e-13), ORDERS),
    Statement("(18)", THEOREM, "r terms give a symplectic scheme of order r",
              every(*(order(_generating(r), r) for r in (2, 3, 4)), has(_generating(4), "symplecticity")), ORDERS),
    Statement("(19)", METHOD, "Scheme I is r = 1", order(_generating(1), 1), ORDERS),
    Statement("(20)", METHOD, "Scheme II, r = 2, has order 2",
              every(order(labels("scheme-ii"), 2), has(labels("scheme-ii"), "symplecticity")), ORDERS),
    Statement("(21)", METHOD, "Scheme III is symmetric and of order 2",
              every(order(labels("scheme-iii"), 2), has(labels("scheme-iii"), "symmetry")), ORDERS),
    Statement("Scheme III", REMARK, "is symplectic, as a composition", has(labels("scheme-iii"), "symplecticity"),
              STRUCTURE),
    Statement("Compositions", REMARK, "of Scheme III give higher order, symmetric and symplectic",
              every(order(labels("scheme-iii-yoshida-4"), 4), order(("scheme-iii-yoshida-6(lam=1/3)",), 6),
                    has(("scheme-iii-yoshida-6(lam=1/3)",), "symmetry")), ORDERS),
    Statement("Remarks I, 1", REMARK, "one scheme covers Euler and midpoint", check("special-values", 1e-14),
              STRUCTURE),
    Statement("Remarks I, 1", REMARK, "special values of λ are of wide practical use",
              untestable("a judgement of use"), "trade"),
    Statement("Remarks I, 2", REMARK, "generating functions and Hamilton–Jacobi equations are generalized",
              every(check("exact-form", 1e-9), check("hamilton-jacobi", 1e-8)), STRUCTURE),
    Statement("Remarks I, 3", REMARK, "two classes of parameterized schemes of arbitrary order",
              every(order(_generating(6), 6), order(("scheme-iii-hlw-10(lam=1/3)",), 10)), ORDERS),
)  # fmt: skip

PRESERVING: tuple[Statement, ...] = (
    Statement("Scheme IV", METHOD, "Scheme I with λ chosen so that H is kept", roots("scheme-iv"), ENERGY),
    Statement("Scheme IV, heading", REMARK, "is of order 1", exactly("scheme-iv", 1), ORDERS),
    Statement("Scheme V", METHOD, "Scheme III with λ chosen so that H is kept", roots("scheme-v"), ENERGY),
    Statement("Scheme V, heading", REMARK, "is of order 2", exactly("scheme-v", 2), ORDERS),
    Statement("(22)", REMARK, "for fixed λ the scheme is symplectic", check("any-parameter", 1e-11), STRUCTURE),
    Statement("(22)", REMARK, "so every quadratic invariant is kept for fixed λ",
              where(check("momentum", KEPT), check("mass", KEPT, -1), "the invariant is q·Dp, or λ = 1/2"), WAVES),
    Statement("(23)", REMARK, "different λ in each step keep the energy", roots(*TUNED), ENERGY),
    Statement("Remark", REMARK, "Schemes IV and V keep energy and quadratic invariants",
              where(charge, nls_mass, "the invariant is q·Dp"), WAVES),
    Statement("(24)–(25)", FORMULA, "the joint Newton matrix is singular at h = 0", check("singular", 1e-14), ENERGY),
    Statement("(26), Theorem (1)", THEOREM, "for small h there is λ(h) with E(λ(h), h) = 0",
              roots(*TUNED, condition="h is small enough for the state"), ENERGY),
    Statement("Theorem (2)", THEOREM, "λ(h) = 1/2 + ε(h) h, ε = constant + O(h)", where(check("solvable", 0.1, 1e-9),
              check("degenerate", 0.1, 1e-9), "d/dt(H_p·H_q) ≠ 0"), ENERGY),
    Statement("Remarks II, 1", REMARK, "λ stays around 1/2, which explains the midpoint rule's behaviour", middling,
              PK),
    Statement("Remarks II, 2", REMARK, "symplectic and energy-preserving methods are related",
              untestable("a point of view"), ENERGY),
    Statement("Remarks II, 3", REMARK, "energy-preserving methods of arbitrary order",
              every(order(("scheme-v-yoshida-4",), 4), order(("scheme-v-kahan-li-8",), 8),
                    keeps_energy(("scheme-v-yoshida-4", "scheme-v-kahan-li-8"))), ORDERS),
    Statement("Remarks II, 4", REMARK, "symplectic and energy-preserving at once, in a weaker sense only",
              every(has(TUNED, "symplecticity", False), keeps_energy(("scheme-v",))), STRUCTURE),
)  # fmt: skip

SCHEME_I, THREE = "henon-heiles-scheme-i-energy", ("AVF", "Scheme IV", "Scheme V")
HH_ENERGY, PK_LAWS = "henon-heiles-preserving-energy", "perturbed-kepler-preserving-invariants"
BOTH = "perturbed-kepler-scheme-i-iii-invariants"
EXPERIMENTS: tuple[Statement, ...] = (
    Statement("(27)–(28)", SYSTEM, "Hénon–Heiles", check("henon-heiles", 1e-14), "problems"),
    Statement("(28), data", FORMULA, "box orbit H₀ = 0.02, chaotic orbit H₀ = 1/6", check("henon-heiles-data", 1e-15),
              "problems"),
    Statement("Orbits of Scheme I", FIGURE, "box and chaotic orbits, four λ",
              completed_runs("henon-heiles-scheme-i-orbits", 8), HH),
    Statement("Energy of Scheme I", FIGURE, "the error stays bounded on both orbits",
              curves(SCHEME_I, "energy_error", 0.01), HH),
    *(Statement(f"Table 1, Scheme {name}", TABLE, "16 errors of four λ and their orders",
                printed_entries(f"scheme-{name.lower()}", 16), PRINTED) for name in ("I", "II", "III")),
    Statement("Orbits", FIGURE, "AVF, Schemes IV, V to t = 1000, box and chaotic",
              completed_runs("henon-heiles-preserving-orbits", 6), HH),
    Statement("Energy", FIGURE, "AVF and Scheme V keep the energy", curves(HH_ENERGY, "energy_error", KEPT,
              ("AVF", "Scheme V")), HH),
    Statement("Energy", FIGURE, "Scheme IV keeps the energy", every(roots("scheme-iv"),
              completed_runs("henon-heiles-preserving-energy", 6)), HH),
    *(Statement(f"Table 2, {name}", TABLE, "four errors and their orders", printed_entries(id, 4), PRINTED)
      for name, id in (("AVF", "avf"), ("Scheme IV", "scheme-iv"), ("Scheme V", "scheme-v"))),
    Statement("(29)", SYSTEM, "perturbed Kepler: H₀ ≈ −0.5391, L₀ = 0.8", check("kepler-data", 5e-5), "problems"),
    Statement("(30)", FORMULA, "the angular momentum is a first integral", check("kepler-momentum", 1e-14), PK),
    Statement("Orbits of Scheme I", FIGURE, "perturbed Kepler to t = 1000, four λ",
              completed_runs("perturbed-kepler-scheme-i-orbits", 5), PK),
    Statement("Schemes I and III", FIGURE, "the energy error is bounded",
              curves(BOTH, "largest", 0.1, panel="energy"), PK),
    Statement("Schemes I and III", FIGURE, "the angular momentum is kept",
              curves(BOTH, "largest", KEPT, panel="angular-momentum"), PK),
    Statement("AVF, IV, V", FIGURE, "orbits to t = 1000", completed_runs("perturbed-kepler-preserving-orbits", 4), PK),
    Statement("AVF, IV, V", FIGURE, "all keep the energy", curves(PK_LAWS, "largest", KEPT, THREE, "energy"), PK),
    Statement("AVF, IV, V", FIGURE, "IV and V keep the angular momentum, AVF does not",
              every(curves(PK_LAWS, "largest", KEPT, THREE[1:], "angular-momentum"),
                    curves(PK_LAWS, "largest", KEPT, THREE[:1], "angular-momentum", above=True)), PK),
)  # fmt: skip
