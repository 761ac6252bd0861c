r"""Methods in extended phase space (two copies of the state) without round-off: symplecticity, orders at small steps.

The orbit about a Schwarzschild black hole lies in a plane; the energy E of the particle is a parameter.  In units of
the semilatus rectum :math:`\ell M` for lengths and of :math:`\ell^{3/2} M` for times, with
:math:`\varepsilon = 1/\ell`, its Hamiltonian is

.. math::
    H = \underbrace{\frac{|p|^2}2 - \frac{E^2}{|q|}}_K
    - \varepsilon\underbrace{\Bigl(\frac{2E^2}{|q|^2(1 - 2\varepsilon/|q|)} + \frac{(q\cdot p)^2}{|q|^3}\Bigr)}_{-W},

a Kepler problem with a small part that is not separable.  A splitting made for this problem takes Kepler flows in both
copies and, in place of the exact flow of the small part, a symmetric product of the flows of
:math:`\varepsilon W(q, y)` and :math:`\varepsilon W(x, p)`.  With exact flows it would have a generalised order; the
product adds an error of the size of :math:`\varepsilon^3 h^2`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

import mpmath
import numpy as np
import pandas as pd

from phasebench.benchmarks.judge.evidence import NO_DEFECT
from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.step_map import pair_defect
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Table, of
from phasebench.benchmarks.page.study import Claim, Curves, Runs, Study
from phasebench.benchmarks.page.verdict import Between, at_most
from phasebench.benchmarks.store.cells import UNCOMPILED
from phasebench.integrators import coefficients
from phasebench.integrators.coefficients.copies import midpoint_tableau
from phasebench.integrators.coefficients.fractions import triple_jump
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.families.extended import COPY
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.record import Method
from phasebench.integrators.registry import method as method_of
from phasebench.integrators.stepping import kepler_flow
from phasebench.integrators.stepping.kernel import array, prepare
from phasebench.integrators.systems.hamiltonian import Hamiltonian

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number

STRUCTURE, ORDERS = "extended_structure", "extended_orders"
DEFECT_ORDER = "order of the defect"
#: Largest difference of an order from the declared one that counts as agreement; one so far below it is lost.
GATE, LOST = 0.1, 1.0
DIGITS = 40
#: The maps of which symplecticity is measured.
BOTH, ONE = "both copies", "(q, p)"
#: Non-separable systems of `battery`, and a separable one.
SYSTEMS = ("tao", "coupled", "henon-heiles")
#: The step of the stated defect; the order of the defect is between it and its half.
STEP = Fraction(1, 40)
MAPS = (
    *((id, BOTH) for id in ("tao-2", "tao-4", "pihajoki-2")),
    *((id, ONE) for id in ("tao-2", "jayawardana-ohsawa-2", "jayawardana-ohsawa-4")),
    *((f"extended-midpoint-{order}", ONE) for order in (2, 4, 6)),
    ("rk4", ONE),
)
#: epsilon and the eccentricity of the orbit; the span from pericentre on; the numbers of steps.
EPSILON, ECCENTRICITY, SPAN = Fraction(1, 1000), Fraction(1, 2), Fraction(2)
LADDER = (4, 8, 16, 32, 64, 128)
#: Tao's omega on the orbit, whose own frequency is 1; his bound on the step falls with omega.
OMEGA = 2
#: Splittings made for the small part: a table of generalised order, and a triple jump of the simplest one.
SPECIAL, JUMPED = "aba-864 on Kepler flows", "triple jump on Kepler flows"
#: Label -> method for every H; Tao's have the omega that suits the orbit.
_OTHERS = map(method_of, ("jayawardana-ohsawa-2", "jayawardana-ohsawa-4", "extended-midpoint-4"))
GENERAL = {m.label: m for m in (*(method_of(f"tao-{order}", omega=OMEGA) for order in (2, 4)), *_OTHERS)}


def record_of(id: str) -> Method:
    """The method with an id; "extended-midpoint-2" and "extended-midpoint-6" are not registered."""
    kind, _, order = id.rpartition("-")
    if kind != "extended-midpoint" or order == "4":
        return method_of(id)
    data = midpoint_tableau(triple_jump(int(order)))
    return replace(method_of("extended-midpoint-4"), id=id, order=int(order), data=data)


# -- structure --------------------------------------------------------------------------------------------------------


def map_of_copies(record: Method, system: Hamiltonian) -> Callable:
    """The map (z, h) -> z of both copies z = (q, x, p, y), an array (4 d,), by one step, in many digits."""
    d, prepared = system.d, prepare(record, system, MULTIPRECISION)

    def advance(z: np.ndarray, h: Number) -> np.ndarray:
        run = lay_out(prepared, d, h, z[:d], z[2 * d : 3 * d], MULTIPRECISION)
        table = run.carry.state
        table[COPY, :d], table[COPY + 1, :d] = z[d : 2 * d], z[3 * d :]
        run.counts.steps = 1  # a step was taken: the copy is read, not made
        run(np.zeros((1, d), dtype=object), np.zeros((1, d), dtype=object), np.zeros((1, 1)), 1)
        return np.concatenate([table[k, :d] for k in (0, COPY, 1, COPY + 1)])

    return advance


def defect(record: Method, of: str, name: str, h: Fraction) -> float:
    """The defect of symplecticity of a map, `BOTH` or `ONE`, of a step h on the system ``name`` of `battery`."""
    system, y = multiprecision.start(name)
    h = to_number(h, MULTIPRECISION)
    if of == ONE:
        return float(pair_defect(lambda x: multiprecision.advance(system, record, x, h), y))
    d, advance = system.d, map_of_copies(record, system)
    shift = vector([Fraction(1, 10)] * d)  # copies apart, as they are after many steps
    return float(pair_defect(lambda z: advance(z, h), np.concatenate([y[:d], y[:d] + shift, y[d:], y[d:] - shift])))


def structure(method: str, map: str) -> list[dict]:
    """The defect of a step at `STEP`, and its order in h: a row for each system."""
    record = record_of(method)
    rows = []
    with precision(max(DIGITS, 12 * record.order)):
        for name in SYSTEMS:
            whole, half = (defect(record, map, name, h) for h in (STEP, STEP / 2))
            seen = half > multiprecision.displacement() ** 3  # the differences' own error is far smaller
            found = {"defect": whole, DEFECT_ORDER: float(np.log2(whole / half)) if seen else None}
            rows.append({"problem": name, "order": record.order, "h": float(STEP)} | found)
    return rows


# -- orders -----------------------------------------------------------------------------------------------------------


def orbit() -> tuple[Hamiltonian, Hamiltonian, Fraction, np.ndarray]:
    """(System of H, system of the small part epsilon W, E^2, state (4,) at the pericentre), in MPFR numbers."""
    semilatus, e = 1 / EPSILON, ECCENTRICITY
    squared = ((semilatus - 2) ** 2 - 4 * e**2) / (semilatus * (semilatus - 3 - e**2))
    r, E = "sqrt(x**2 + y**2)", f"({squared})"  # the Kepler part needs no formula
    small = f"-({EPSILON})*(2*{E}/({r}**2*(1 - 2*({EPSILON})/{r})) + (x*u + y*v)**2/{r}**3)"
    whole, part = (Hamiltonian(q="x y", p="u v", H=H) for H in (f"(u**2 + v**2)/2 - {E}/{r} + {small}", small))
    momentum = semilatus / (semilatus - 3 - e**2)  # the angular momentum, squared
    speed = mpmath.sqrt(mpmath.mpf(momentum.numerator) / momentum.denominator) * float(1 + e)
    return whole, part, squared, vector([1 / (1 + e), 0, 0, speed])


def special(id: str, part: Hamiltonian, squared: Fraction, y: np.ndarray, h: Number, steps: int) -> np.ndarray:
    """The mean (q, p) of both copies, array (4,), after ``steps`` steps of a splitting made for the orbit.

    ``part`` is the system of epsilon W, ``squared`` is E^2, which is mu of the Kepler part, ``y`` the start (4,).
    """
    field, table = part.field(MULTIPRECISION), array(kepler_flow.constants(MULTIPRECISION), MULTIPRECISION)
    mu, eps = to_number(squared, MULTIPRECISION), to_number(mpmath.mp.eps, MULTIPRECISION)
    one, zero = to_number(1, MULTIPRECISION), to_number(0, MULTIPRECISION)
    copies = [np.array([y[:2], y[2:], [zero] * 2, [zero] * 2], dtype=object) for _ in range(2)]
    (q, p), (x, v) = (copy[:2] for copy in copies)
    jump = [step for g in triple_jump(4) for step in (("A", g / 2), ("B", g), ("A", g / 2))]
    table_of = coefficients.steps("aba-864") if id == SPECIAL else jump  # "A" is a Kepler flow, "B" the small part
    substeps = [(letter, to_number(c, MULTIPRECISION) * h) for letter, c in table_of]

    def first(length: Number) -> None:  # exp(h epsilon W(q, y))
        dq, dp = field(q, v, h, zero)
        x[:], p[:] = x + length * dq, p + length * dp

    def second(length: Number) -> None:  # exp(h epsilon W(x, p))
        dq, dp = field(x, p, h, zero)
        q[:], v[:] = q + length * dq, v + length * dp

    for _ in range(steps):
        for letter, length in substeps:
            if letter == "A":
                for copy in copies:
                    kepler_flow.advance(copy, 0, 2, one, mu, length, eps, table)
            else:
                first(length / 2)
                second(length)
                first(length / 2)
    return np.concatenate([(q + x) / 2, (p + v) / 2])


def orders(method: str) -> list[dict]:
    """The error on the relativistic orbit and its order: a row for each number of steps."""
    chosen, rows = GENERAL.get(method), []
    with precision(DIGITS):
        whole, part, squared, y = orbit()
        T = to_number(SPAN, MULTIPRECISION)
        end, doubt = multiprecision.flow(whole, y, T)
        for n in LADDER:
            if chosen:
                found = multiprecision.advance(whole, chosen, y, SPAN / n, n)
            else:
                found = special(method, part, squared, y, T / n, n)
            error = float(max(abs(found - end)))
            row = {"declared": chosen.order if chosen else 4, "epsilon": float(EPSILON), "h": float(SPAN / n)}
            order = float(np.log2(rows[-1]["error"] / error)) if rows else None
            rows.append(row | {"steps": n, "error": error, "order": order, "uncertainty": float(doubt)})
    return rows


# -- judging -----------------------------------------------------------------------------------------------------------


@of(ORDERS)
def _finest(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.loc[rows.groupby("method")["h"].idxmin()]


def _answer(data: Data) -> str | None:
    found = [CLAIMS[name](data) for name in ("tao", "semiexplicit", "midpoint")]
    if None in found:
        return None
    copies, own, explicit = (v.expected.met(v.measured) for v in found)
    text = f"Tao's step is {'' if copies else 'not '}symplectic in both copies of the state together"
    text += f", the semiexplicit one {'' if own else 'not '}in the original phase space"
    return f"{text}; the explicit projection to the midpoint is {'' if explicit else 'not '}symplectic."


@of(STRUCTURE)
def table(structure: pd.DataFrame) -> Table:
    """A row for each map, with the largest defect and its orders in h."""
    rows = []
    for (name, map), part in structure.groupby(["method", "map"], sort=False):
        worst, seen = part.loc[part["defect"].idxmax()], part[DEFECT_ORDER].dropna()
        orders = f"{seen.min():.1f} to {seen.max():.1f}" if len(seen) else ""
        row = {"method": name, "map": map, "defect": worst["defect"], "on": worst["problem"]}
        rows.append(row | {DEFECT_ORDER: orders})
    caption = (
        f"Largest defect of symplecticity of a step h = {STEP} over three systems, and the order in h with which it "
        "vanishes (blank: it is the differences' own). rk4 is the control."
    )
    return Table(pd.DataFrame(rows).head(ROWS), caption)


@of(ORDERS)
def whole(orders: pd.DataFrame) -> pd.DataFrame:
    """The errors and orders at all steps."""
    columns = ["method", "declared", "h", "steps", "error", "order"]
    return orders[columns].assign(order=orders["order"].map(lambda x: "" if np.isnan(x) else f"{x:.2f}"))


NONE_AT_ALL = at_most(NO_DEFECT)
CLAIMS = {
    "tao": Claim(
        "Tao's step of both copies is symplectic",
        STRUCTURE, "defect", NONE_AT_ALL, rows=f"method.str.startswith('tao') and map == '{BOTH}'", fault=True,
    ),
    "semiexplicit": Claim(
        "Jayawardana and Ohsawa's step is symplectic in the original phase space",
        STRUCTURE, "defect", NONE_AT_ALL, rows=f"method.str.startswith('jayawardana') and map == '{ONE}'", fault=True,
    ),
    "midpoint": Claim(
        "An explicit step projected to the copies' midpoint is symplectic for every H",
        STRUCTURE, "defect", NONE_AT_ALL, rows=f"method.str.startswith('extended-midpoint') and map == '{ONE}'",
    ),
    "general": Claim(
        "Methods for every H keep their order on a relativistic orbit at small steps",
        _finest, "order - declared", Between(-GATE, GATE), f"method not in ('{SPECIAL}', '{JUMPED}')",
        unit="from the declared order", where="{method}, h = {h:.3g}", fault=True,
    ),
    "special": Claim(
        "A splitting made for post-Newtonian parts loses its order at small steps",
        _finest, "order", at_most(4 - LOST), rows=f"method == '{SPECIAL}'", unit="as the order",
        where="h = {h:.3g}", checked=True,
    ),
}  # fmt: skip
STUDY = Study(
    id="extended",
    place=270,
    question="Are the explicit methods in extended phase space what their papers claim?",
    answer=_answer,
    setting=(
        "H(q, y) + H(x, p): on two copies (q, p), (x, y) of the state, each part has an explicit flow, whatever H is.",
        "Tao 2016 binds the copies; Jayawardana and Ohsawa 2023 project symmetrically (implicit); the midpoint "
        "(q + x, p + y)/2 is the explicit projection (Luo et al. 2017).",
        "Mei, Wu and Jiang (arXiv 2504.12567) state explicit maps that are symplectic in the original phase space for "
        "every H.",
        "Liang and Mei (arXiv 2607.01596) report that post-Newtonian splittings lose their order at small steps: a "
        f"Schwarzschild orbit, ε = {EPSILON}, e = {ECCENTRICITY}, as a Kepler problem plus ε W(q, p).",
        f"All in {DIGITS} digits or more; systems (q² + 1)(p² + 1)/2, a coupled double well with p in its coupling, "
        "Hénon–Heiles.",
    ),
    runs=(
        Runs(STRUCTURE, structure, [{"method": id, "map": of} for id, of in MAPS],
             needs=lambda method, map: (record_of(method),), where=UNCOMPILED),
        Runs(ORDERS, orders, [{"method": label} for label in (*GENERAL, SPECIAL, JUMPED)],
             needs=lambda method: (GENERAL[method],) if method in GENERAL else (), where=UNCOMPILED),
    ),
    claims=CLAIMS,
    checks={
        "copies": Claim("Steps of both copies are symplectic", STRUCTURE, "defect", NONE_AT_ALL,
                        rows=f"map == '{BOTH}'"),
        "jumped": Claim(
            "A triple jump on Kepler flows keeps its order",
            _finest, "order - declared", Between(-GATE, GATE), rows=f"method == '{JUMPED}'",
        ),
    },
    figure=(Curves(ORDERS, "h", "error", "step h", "error at the end"),),
    legend=3,
    title="error on a relativistic orbit",
    caption=f"Error of (q, p) at t = {number(float(SPAN))} after the pericentre against the step, in {DIGITS} digits. "
    f"The order is the slope: that of {SPECIAL}, made for the small part, falls to 2 at small steps.",
    shown=table,
    whole=whole,
    limits=(
        "Of both arXiv papers only the abstracts could be read. The explicit map is taken to be the projection to the "
        "midpoint, the special splitting to be ABA(8,6,4) with Kepler flows and a symmetric product for ε W.",
        "From equal copies the step projected to the midpoint is an explicit Runge–Kutta method. Symplecticity for "
        "every H needs b² = 0 for each of its weights b, as of any explicit partitioned Runge–Kutta method.",
        f"A defect of at most {NO_DEFECT:g} counts as none. The projected step's vanishes with h to the power 2p + 2 "
        "at order p: in double precision it is not seen at order 4.",
        "The abstract has the loss of order at h < ε³, in its own units; here ε³h², of the symmetric product, exceeds "
        "εh⁸, of the table, below h = ε^(1/3).",
        f"On the orbit Tao's ω is {OMEGA}; with his default, 20, the steps would have to be ten times shorter.",
    ),
)  # fmt: skip
