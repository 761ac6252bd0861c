r"""The energy of Hessian-free force gradients on chaotic and on regular orbits, beside the steps with the Hessian.

The steps are symmetric and keep the volume but are not symplectic, so that no theorem bounds the energy.  On chaotic
orbits of

.. math:: H = \tfrac12 |p|^2 + \tfrac12 x^2 y^2 + \tfrac1{40}(x^4 + y^4) = 1

the change of the energy over a run is taken as the mean of its last tenth less that of its first tenth.  Orbits from
random starts are independent: their mean change over the time between is the drift, with Student's interval, and their
standard deviation the spread, which a random walk of the energy makes grow.  On regular orbits the drift is that of the
series (`measure.drift`).
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.systems.hamiltonian import Hamiltonian

CHAOTIC, REGULAR = "hessian_free_chaotic", "hessian_free_regular"
#: Method -> the one with the same structure of drifts and kicks, and with the Hessian.
WITH = {
    "hessian-free-badab": "chin-4a",
    "hessian-free-adada": "chin-4b",
    "hessian-free-abadaba": "omelyan-4-3f1g-p",
    "hessian-free-adadada": "omelyan-4-3f3g-p",
    "hessian-free-abadabadaba": "omelyan-4-5f2g-p",
    "hessian-free-badadadab": "omelyan-6-4f3g-v",
    "hessian-free-badadadadab": "omelyan-6-5f4g-v",
}
METHODS = (*WITH, *WITH.values())
#: A method whose energy drifts, on the chaotic orbits.
CONTROL = "rk4"
#: Step, number of steps, rows kept, orbits and seed of the chaotic runs.
H, STEPS, ROWS, ORBITS, SEED = 0.2, 1_000_000, 2000, 64, 1
#: Problem -> step of the regular runs, of so many steps, of which so many rows are kept.
ORBIT_STEPS = {"henon-heiles:box": 0.5, "perturbed-kepler": 0.05, "pendulum:swinging": 0.5}
REGULAR_STEPS, REGULAR_ROWS = 200_000, 4000


def quartic() -> Hamiltonian:
    """The chaotic system."""
    return Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + x**2*y**2/2 + (x**4 + y**4)/40")


def starts(system: Hamiltonian, n: int = ORBITS) -> tuple[np.ndarray, np.ndarray]:
    """Random states of the energy 1, arrays (n, 2)."""
    generator = np.random.default_rng(SEED)
    Q, angle = generator.uniform(-1, 1, (n, 2)), generator.uniform(0, 2 * np.pi, n)
    speed = np.sqrt(2 * (1 - system.energies(Q, 0 * Q)))
    return Q, speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def student(x: np.ndarray) -> tuple[float, float, float]:
    """The mean of independent numbers with its 95 % interval."""
    from scipy.stats import t

    half = t.ppf(0.975, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x))
    return float(x.mean()), float(x.mean() - half), float(x.mean() + half)


def chaotic(method: str, steps: int = STEPS, h: float = H) -> dict:
    """The row of a method on chaotic orbits."""
    system = quartic()
    every = steps // ROWS
    found = integrate_ensemble(system, method, *starts(system), h=h, steps=every * ROWS, save_every=every, threads=1)
    E = np.array([system.energies(q, p) for q, p in zip(found.Q, found.P, strict=True)])
    tenth = ROWS // 10
    changes = E[:, -tenth:].mean(axis=1) - E[:, 1 : tenth + 1].mean(axis=1)
    between = 0.9 * h * every * ROWS
    mean, low, high = (x / between for x in student(changes))
    return {
        "method": method,
        "with the Hessian": WITH.get(method, ""),
        "h": h,
        "orbits": len(E),
        "failed": int((found.status != "ok").sum()),
        "drift": mean,
        "low": low,
        "high": high,
        "change": mean * between,
        "spread": float(changes.std(ddof=1)),
        "oscillation": float(np.abs(E - E[:, :1]).max()),
    }


def regular(method: str, name: str, steps: int = REGULAR_STEPS) -> dict:
    """The row of a method on a regular orbit; the change is that of the drift over the whole run."""
    of, h = problem(name), ORBIT_STEPS[name]
    s = integrate(of, method, h=h, steps=steps, save_every=steps // REGULAR_ROWS)
    E = of.system.energies(s.q, s.p)
    slope = drift(s.t, E - E[0])
    row = {"method": method, "with the Hessian": WITH.get(method, ""), "problem": name, "h": h, "status": s.status}
    row |= {"drift": slope.value, "low": slope.low, "high": slope.high}
    return row | {"change": abs(slope.value) * s.t[-1], "oscillation": float(np.abs(E - E[0]).max())}


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each method on the chaotic orbits and on each regular one; none in the quick tier."""
    if quick:
        return []
    return [_chaotic(m) for m in (*METHODS, CONTROL)] + [_regular(m, name) for m in METHODS for name in ORBIT_STEPS]


def _chaotic(method: str) -> Cell:
    about = content("chaotic", BY_ID[method], code=[__name__])
    return Cell("sampling", (CHAOTIC,), {"method": method}, chaotic_rows, (method,), about, frozenset({method}))


def _regular(method: str, name: str) -> Cell:
    about = content("regular", BY_ID[method], ProblemKey(name), code=[__name__])
    key = {"method": method, "problem": name}
    return Cell("sampling", (REGULAR,), key, regular_rows, (method, name), about, frozenset({method}))


def chaotic_rows(method: str) -> Rows:
    """The row of `chaotic`."""
    return {CHAOTIC: [chaotic(method)]}


def regular_rows(method: str, name: str) -> Rows:
    """The row of `regular`."""
    return {REGULAR: [regular(method, name)]}
