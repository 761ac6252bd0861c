r"""Methods in extended phase space (two copies of the state) without round-off: symplecticity, orders at small steps.

- **Structure**: the defect of symplecticity of a step, either as a map of both copies (q, x, p, y) or as a map of
  (q, p) that starts from equal copies, and the order in h with which this defect vanishes.
- **Orders**: the error of both copies' mean on a bound orbit around a Schwarzschild black hole, step by step, and the
  order between neighbouring steps.

The orbit lies in a plane; the energy E of the particle is a parameter.  In units of the semilatus rectum
:math:`\ell M` for lengths and of :math:`\ell^{3/2} M` for times, with :math:`\varepsilon = 1/\ell`, its Hamiltonian is

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

from phasebench.benchmarks.measure import multiprecision
from phasebench.benchmarks.measure.step_map import pair_defect
from phasebench.benchmarks.store.cells import UNCOMPILED, Cell, Rows, content
from phasebench.integrators import coefficients
from phasebench.integrators.coefficients.copies import midpoint_tableau
from phasebench.integrators.coefficients.fractions import triple_jump
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.families.extended import COPY
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.record import Method
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kepler_flow
from phasebench.integrators.stepping.kernel import array, prepare
from phasebench.integrators.systems.hamiltonian import Hamiltonian

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number

STRUCTURE, ORDERS = "extended_structure", "extended_orders"
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
GENERAL = ("tao-2", "tao-4", "jayawardana-ohsawa-2", "jayawardana-ohsawa-4", "extended-midpoint-4")
CODE = (__name__,)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): one for each map of `MAPS` and each method on the orbit; none if ``quick``."""
    if quick:
        return []
    maps = [_cell(STRUCTURE, {"method": id, "map": of}, structure, (id, of), record_of(id)) for id, of in MAPS]
    general = [_cell(ORDERS, {"method": on_orbit(id).label}, orders, (id,), on_orbit(id)) for id in GENERAL]
    return maps + general + [_cell(ORDERS, {"method": id}, orders, (id,)) for id in (SPECIAL, JUMPED)]


def _cell(table: str, key: dict, measure: Callable, arguments: tuple, *chosen: Method) -> Cell:
    needs = content(table, *arguments, *chosen, code=CODE)
    names = frozenset(m.id for m in chosen)
    return Cell("extended", (table,), key, measure, arguments, needs, names, UNCOMPILED)


def record_of(id: str) -> Method:
    """Return the method with an id; the unregistered "extended-midpoint-2" and "extended-midpoint-6" are made here."""
    kind, _, order = id.rpartition("-")
    if kind != "extended-midpoint" or order == "4":
        return method(id)
    data = midpoint_tableau(triple_jump(int(order)))
    return replace(method("extended-midpoint-4"), id=id, order=int(order), data=data)


def on_orbit(id: str) -> Method:
    """Return the method with an id; Tao's methods have the parameter omega that suits the relativistic orbit."""
    return method(id, omega=OMEGA) if id.startswith("tao") else method(id)


# -- structure --------------------------------------------------------------------------------------------------------


def map_of_copies(record: Method, system: Hamiltonian) -> Callable:
    """Make the map (z, h) -> z of both copies z = (q, x, p, y), an array (4 d,), by one step, in many digits."""
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
    """Compute the defect of symplecticity of a step h by the method ``record`` on the system ``name`` of `battery`.

    ``of`` selects the map: `BOTH` for that of both copies, `ONE` for that of (q, p) from equal copies.
    """
    system, y = multiprecision.start(name)
    h = to_number(h, MULTIPRECISION)
    if of == ONE:
        return float(pair_defect(lambda x: multiprecision.advance(system, record, x, h), y))
    d, advance = system.d, map_of_copies(record, system)
    shift = vector([Fraction(1, 10)] * d)  # copies apart, as they are after many steps
    return float(pair_defect(lambda z: advance(z, h), np.concatenate([y[:d], y[:d] + shift, y[d:], y[d:] - shift])))


def structure(id: str, of: str) -> Rows:
    """Measure the symplecticity defect of a method's step at `STEP`, and its order in h: a row for each system.

    ``of`` selects the map: `BOTH` for that of both copies, `ONE` for that of (q, p) from equal copies.
    """
    record = record_of(id)
    rows = []
    with precision(max(DIGITS, 12 * record.order)):
        for name in SYSTEMS:
            whole, half = (defect(record, of, name, h) for h in (STEP, STEP / 2))
            seen = half > multiprecision.displacement() ** 3  # the differences' own error is far smaller
            found = {"defect": whole, "order of the defect": float(np.log2(whole / half)) if seen else None}
            rows.append({"method": id, "map": of, "problem": name, "order": record.order, "h": float(STEP)} | found)
    return {STRUCTURE: rows}


# -- orders -----------------------------------------------------------------------------------------------------------

#: The Kepler part needs no formula; r is |q|.
RADIUS = "sqrt(x**2 + y**2)"


def orbit() -> tuple[Hamiltonian, Hamiltonian, Fraction, np.ndarray]:
    """Make the relativistic orbit: (system of H, system of the small part epsilon W, E^2, state at the pericentre).

    E is the energy of the particle; the state (q, p) is an array (4,) of MPFR numbers.
    """
    semilatus, e = 1 / EPSILON, ECCENTRICITY
    squared = ((semilatus - 2) ** 2 - 4 * e**2) / (semilatus * (semilatus - 3 - e**2))
    r, E = RADIUS, f"({squared})"
    small = f"-({EPSILON})*(2*{E}/({r}**2*(1 - 2*({EPSILON})/{r})) + (x*u + y*v)**2/{r}**3)"
    whole, part = (Hamiltonian(q="x y", p="u v", H=H) for H in (f"(u**2 + v**2)/2 - {E}/{r} + {small}", small))
    momentum = semilatus / (semilatus - 3 - e**2)  # the angular momentum, squared
    speed = mpmath.sqrt(mpmath.mpf(momentum.numerator) / momentum.denominator) * float(1 + e)
    return whole, part, squared, vector([1 / (1 + e), 0, 0, speed])


def special_steps(id: str) -> list[tuple[str, mpmath.mpf]]:
    """Return the substeps of a splitting made for the orbit, (letter, fraction of h).

    The letter is "A" for Kepler flows, "B" for flows of the small part.
    """
    if id == SPECIAL:
        return coefficients.steps("aba-864")
    out: list = []
    for g in triple_jump(4):
        out += [("A", g / 2), ("B", g), ("A", g / 2)]
    return out


def special(id: str, part: Hamiltonian, squared: Fraction, y: np.ndarray, h: Number, steps: int) -> np.ndarray:
    """Integrate with a splitting made for the orbit, and return the mean (q, p) of both copies, array (4,).

    Parameters
    ----------
    id : `SPECIAL` or `JUMPED`, the names of the two splittings
    part : the system of the small part epsilon W
    squared : E^2, which is mu of the Kepler part
    y, h, steps : the start (4,), the step size, the number of steps
    """
    field, table = part.field(MULTIPRECISION), array(kepler_flow.constants(MULTIPRECISION), MULTIPRECISION)
    mu, eps = to_number(squared, MULTIPRECISION), to_number(mpmath.mp.eps, MULTIPRECISION)
    one, zero = to_number(1, MULTIPRECISION), to_number(0, MULTIPRECISION)
    copies = [np.array([y[:2], y[2:], [zero] * 2, [zero] * 2], dtype=object) for _ in range(2)]
    (q, p), (x, v) = (copy[:2] for copy in copies)
    substeps = [(letter, to_number(c, MULTIPRECISION) * h) for letter, c in special_steps(id)]

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


def orders(id: str) -> Rows:
    """Measure a method's error on the relativistic orbit and its order: a row for each number of steps."""
    chosen = None if id in (SPECIAL, JUMPED) else on_orbit(id)
    about = {"method": chosen.label if chosen else id, "declared": chosen.order if chosen else 4}
    rows, last = [], None
    with precision(DIGITS):
        whole, part, squared, y = orbit()
        T = to_number(SPAN, MULTIPRECISION)
        end, doubt = multiprecision.flow(whole, y, T)
        for n in LADDER:
            if chosen:
                found = multiprecision.advance(whole, chosen, y, SPAN / n, n)
            else:
                found = special(id, part, squared, y, T / n, n)
            error = float(max(abs(found - end)))
            row = about | {"epsilon": float(EPSILON), "h": float(SPAN / n), "steps": n, "error": error}
            row |= {"order": None if last is None else float(np.log2(last / error)), "uncertainty": float(doubt)}
            rows.append(row)
            last = error
    return {ORDERS: rows}
