r"""The energy of Hessian-free force-gradient methods on chaotic and on regular orbits, beside those with the Hessian.

A Hessian-free method replaces the gradient of the squared force in a kick by a second evaluation of the force.  Its
steps are symmetric and keep the volume but are not symplectic, so that no theorem bounds the energy.  On chaotic orbits
of

.. math:: H = \tfrac12 |p|^2 + \tfrac12 x^2 y^2 + \tfrac1{40}(x^4 + y^4) = 1

the change of the energy over a run is its mean over the last tenth less its mean over the first tenth.  Orbits from
random starts are independent: the mean of their changes, divided by the time between, is the drift, with Student's
interval; the standard deviation of the changes is the spread, which grows if the energy makes a random walk.  On a
regular orbit the drift is the slope of the energy over time (`measure.drift`).
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
#: A method whose energy drifts on the chaotic orbits, and the part of the steps after which it is still near.
CONTROL, EARLIER = "rk4", 50
#: Step, number of steps, rows kept, orbits and seed of the chaotic runs.
H, STEPS, ROWS, ORBITS, SEED = 0.2, 1_000_000, 2000, 64, 1
#: Problem -> step of the regular runs, of so many steps, of which so many rows are kept.
ORBIT_STEPS = {"henon-heiles:box": 0.5, "perturbed-kepler": 0.05, "pendulum:swinging": 0.5}
REGULAR_STEPS, REGULAR_ROWS = 200_000, 4000


def quartic() -> Hamiltonian:
    """Return the chaotic system H = (u^2 + v^2) / 2 + x^2 y^2 / 2 + (x^4 + y^4) / 40 in q = (x, y) and p = (u, v)."""
    return Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + x**2*y**2/2 + (x**4 + y**4)/40")


def starts(system: Hamiltonian, n: int = ORBITS) -> tuple[np.ndarray, np.ndarray]:
    """Draw ``n`` random states of the energy 1: (q, p), arrays (n, 2); the seed is fixed.

    ``system`` is that of `quartic`.
    """
    generator = np.random.default_rng(SEED)
    Q, angle = generator.uniform(-1, 1, (n, 2)), generator.uniform(0, 2 * np.pi, n)
    speed = np.sqrt(2 * (1 - system.energies(Q, 0 * Q)))
    return Q, speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def student(x: np.ndarray) -> tuple[float, float, float]:
    """Return (mean, low, high) of independent numbers, array (n,): their mean and its 95 % interval by Student's t."""
    from scipy.stats import t

    half = t.ppf(0.975, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x))
    return float(x.mean()), float(x.mean() - half), float(x.mean() + half)


def chaotic(method: str, steps: int = STEPS, h: float = H) -> dict:
    """Measure the drift of the energy by a method on `ORBITS` chaotic orbits: a row, as a dict.

    It has the drift per unit of time with its 95 % interval ("low", "high"), the mean change over the run ("change"),
    the standard deviation of the orbits' changes ("spread"), the largest |H - H0| ("oscillation"), the number of failed
    orbits, and the id of the method of the same structure with the Hessian ("" if there is none).
    """
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
    """Measure the drift of the energy by a method on a regular orbit, that of the problem ``name``: a row, as a dict.

    It has the drift per unit of time with its interval ("low", "high"), the drift's size times the span ("change"), the
    largest |H - H0| ("oscillation"), the run's status, and the id of the method with the Hessian ("" if there is none).
    """
    of, h = problem(name), ORBIT_STEPS[name]
    s = integrate(of, method, h=h, steps=steps, save_every=steps // REGULAR_ROWS)
    E = of.system.energies(s.q, s.p)
    slope = drift(s.t, E - E[0])
    row = {"method": method, "with the Hessian": WITH.get(method, ""), "problem": name, "h": h, "status": s.status}
    row |= {"drift": slope.value, "low": slope.low, "high": slope.high}
    return row | {"change": abs(slope.value) * s.t[-1], "oscillation": float(np.abs(E - E[0]).max())}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): each method on the chaotic orbits, and on each regular one; none if ``quick``."""
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
    """Measure the drift of the energy by a method on chaotic orbits: {`CHAOTIC`: [the row of `chaotic`]}.

    The control, a Runge-Kutta method whose energy drifts, makes fewer steps.
    """
    return {CHAOTIC: [chaotic(method, STEPS // EARLIER if method == CONTROL else STEPS)]}


def regular_rows(method: str, name: str) -> Rows:
    """Measure the energy's drift on a regular orbit of the problem ``name``: {`REGULAR`: [the row of `regular`]}."""
    return {REGULAR: [regular(method, name)]}
