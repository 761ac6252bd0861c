r"""The curves of the talks' figures: images of sets, orbits, Poincare sections, errors, refinement differences.

The area within a closed curve is that of its trigonometric interpolant, the polygon formula
:math:`\tfrac12\sum (q_i p_{i+1} - q_{i+1} p_i)` in the limit of many vertices: with
:math:`q + \mathrm ip = \sum_k c_k e^{\mathrm ik\theta}` it is :math:`\pi\sum_k k\,|c_k|^2`, exact to round-off for an
analytic curve if the n vertices are enough.

Source: talk on symplectic integration; Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical
Hamiltonian systems" (talk); E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), I.1 and VI.2;
M. Henon, Physica D 5 (1982) 412-414 (sections).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks import problems
from phasebench.benchmarks.measure import variants
from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.store.arrays import pack
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

#: Largest number of points of a stored curve, and their significant digits: a figure of 7 inches shows no more.
POINTS, DIGITS = 2500, 4
#: Refinement differences below this are not used for an order: round-off is near.
NOISE = 1e-12
#: End of long runs; their orbits are stored up to the second time; end of the sections.
END, DRAWN, LONG = 1000.0, 400.0, 8000.0
#: Steps on Henon-Heiles, perturbed Kepler and Lotka-Volterra.
HENON, KEPLER, LOTKA = 0.02, 0.01, 0.12
#: Curve label -> (method id, parameters).
Methods = Mapping[str, tuple[str, dict]]
SCHEME_I, SCHEME_III = (
    {f"λ = {lam}": (id, {"lam": Fraction(lam)}) for lam in variants.LAMBDAS} for id in ("scheme-i", "scheme-iii")
)
PRESERVING: Methods = {"AVF": ("avf", {}), "Scheme IV": ("scheme-iv", {}), "Scheme V": ("scheme-v", {})}
#: Orbit of Henon-Heiles -> half width of the drawn square in the (q1, q2) plane.
ORBITS = {"box": 0.26, "chaotic": 1.05}


@cache
def start(name: str) -> Problem:
    """The problem with the name "id" or "id:orbit", made only once so that its functions stay compiled."""
    return problems.problem(name)


def _run(problem: Problem, id: str, h: float, t_end: float, **parameters: Any) -> Solution:
    return integrate(problem, id, h=h, t_end=t_end, parameters=parameters)


def _error(problem: Problem, s: Solution, invariant: str = "energy") -> np.ndarray:
    """|F - F0| of the energy, or another invariant, along a solution: array (n,)."""
    expression = problem.system.H if invariant == "energy" else problem.invariants[invariant]
    values = problem.system.observe(expression, s.q, s.p)
    return np.abs(values - values[0])


def row(panel: str, curve: str, x: ArrayLike, y: ArrayLike, s: Solution | None = None, **values: Any) -> dict:
    """The row of one curve of a figure: its panel, label ``curve``, run, points (x, y), and further columns."""
    of_run, digits = {}, values.pop("digits", DIGITS)
    if s is not None:
        of_run = {"method": s.method.label, "name": s.method.name, "h": s.h, "t_end": float(s.t[-1])}
        of_run |= {"status": s.status, "reason": s.reason} | {k: s.counts[k] for k in ("steps", "fallbacks")}
    return {"panel": panel, "curve": curve} | of_run | values | {"x": pack(x, digits), "y": pack(y, digits)}


def _binned_maxima(t: np.ndarray, e: np.ndarray, bins: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Thin a curve (t, e) without losing peaks: (times, values) of the largest e in each of ``bins`` equal pieces."""
    edges = np.linspace(0, len(e), min(bins, len(e)) + 1).astype(int)
    best = np.array([a + np.argmax(e[a:b]) for a, b in pairwise(edges)])
    return t[best], e[best]


def _thin_path(q: np.ndarray, n: int = POINTS) -> np.ndarray:
    """Thin a plane path, array (steps, 2), to at most ``n`` points that are about equally spaced: array (m, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(q, axis=0).T))])
    return q[np.unique(np.searchsorted(along, np.linspace(0, along[-1], n)).clip(max=len(q) - 1))]


def carry(problem: Problem, id: str, points: np.ndarray, h: float, snapshots: int, substeps: int = 1) -> np.ndarray:
    """Map points (q, p), array (n, 2 d), by a method: array (snapshots + 1, n, 2 d), whose first entry is the points.

    Between two snapshots are ``substeps`` steps h.  Raises InvalidInput if the integration of a point fails.
    """
    d = points.shape[1] // 2
    rows = []
    for y in points:
        s = integrate(problem, id, h=h, steps=snapshots * substeps, q0=y[:d], p0=y[d:], save_every=substeps)
        if s.status not in ("ok", "inaccurate", "unstable"):  # the map is shown, whatever its energy error
            raise InvalidInput(f"the point {y.tolist()} is lost: {s.status}, {s.reason}")
        rows.append(np.hstack([s.q, s.p]))
    return np.stack(rows, axis=1)


def enclosed_area(curve: np.ndarray) -> float:
    """The oriented area within a closed curve through points (q, p), array (n, 2); counterclockwise is positive."""
    n = len(curve)
    c = np.fft.fft(curve[:, 0] + 1j * curve[:, 1]) / n
    return float(np.pi * np.sum(np.fft.fftfreq(n, 1 / n) * np.abs(c) ** 2))


def outline(centre: tuple[float, float], size: float, n: int, ears: float = 0.0) -> np.ndarray:
    """N points on a circle, array (n, 2), or on a cat's face, an analytic curve with two ``ears`` of this height."""
    angle = 2 * np.pi * np.arange(n) / n
    height = sum(np.exp(18 * (np.cos(angle - at) - 1)) for at in (np.pi / 4, 3 * np.pi / 4))
    r = size * (1 + ears * height)
    return np.array(centre) + np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)


#: Panel -> (method, steps between two of the images of the cat); the exact flow is a method with small steps.
CARRIERS = {
    "exact flow": ("rk4", 400),
    "symplectic Euler": ("symplectic-euler-p", 1),
    "implicit midpoint": ("implicit-midpoint", 1),
    "explicit Euler": ("explicit-euler", 1),
}


def _pendulum_area() -> list[dict]:
    eyes = {f"{side} eye": outline((x, 1.45), 0.07, 24) for side, x in (("left", -0.16), ("right", 0.16))}
    rows = []
    for title, (id, substeps) in CARRIERS.items():
        for part, points in ({"face": outline((0.0, 1.35), 0.42, 512, ears=0.55)} | eyes).items():
            images = carry(start("pendulum"), id, points, np.pi / 4 / substeps, 4, substeps)
            for k, image in enumerate(images):
                area = {"area": enclosed_area(image)} if part == "face" else {}
                rows.append(row(title, f"{part} {k}", *image.T, **area))
    return rows


#: The vectors (q1, q2, p1, p2) that span a parallelogram.
XI, ETA = np.array([0.2, 0.1, 1.2, 0.7]), np.array([1.0, -0.5, 0.3, -0.6])


def _linear_map() -> list[dict]:
    H = "(p1**2 + p2**2)/2 + (q1**2 + 2*q2**2)/2 + (q1 - q2)**2/2"
    shapes = {"before": (XI, ETA)}
    for title, id in (("implicit midpoint", "implicit-midpoint"), ("explicit Euler", "explicit-euler")):
        shapes[title] = carry(Hamiltonian(q="q1, q2", p="p1, p2", H=H), id, np.stack([XI, ETA]), 0.9, 1)[1]
    return [row(title, "xi and eta", *both, digits=17) for title, both in shapes.items()]


def _lotka_flow() -> list[dict]:
    sets = carry(start("lotka-volterra"), "rk4", outline((3.0, 2.0), 0.4, 256), 0.9 / 300, 4, 300)
    rows = []
    for k, points in enumerate(sets):
        areas = {"area": abs(enclosed_area(points)), "measure": abs(enclosed_area(np.log(points)))}
        rows.append(row("disc", f"{k * 0.9:g}", *points.T, **areas))
    return rows


def _lotka_methods() -> list[dict]:
    """The talk's orbits; its symplectic Euler method is implicit in u, explicit in v."""
    rows = []
    for title, id, orbit in (
        ("explicit Euler", "explicit-euler", "2-2"),
        ("implicit Euler", "implicit-euler", "4-8"),
        ("symplectic Euler", "symplectic-euler-q", "4-2"),
        ("symplectic Euler", "symplectic-euler-q", "6-2"),
        ("implicit midpoint", "implicit-midpoint", "4-2"),
        ("implicit midpoint", "implicit-midpoint", "2-2"),
    ):
        made = start(f"lotka-volterra:{orbit}")
        exact, s = _run(made, "rk4", LOTKA / 50, 120 * LOTKA), _run(made, id, LOTKA, 120 * LOTKA)
        rows.append(row(title, "exact flow", *_thin_path(np.hstack([exact.q, exact.p]), n=400).T, exact))
        H = made.system.observe(made.system.H, s.q, s.p)
        change = {"end": H[-1] - H[0], "energy_error": _error(made, s).max()}
        rows.append(row(title, made.start.about, s.q, s.p, s, **change))
    return rows


def _henon(methods: Methods, t_end: float = END) -> Iterator[tuple[str, str, Problem, Solution]]:
    """Yield (orbit, curve label, problem, solution) of every method on both orbits."""
    for orbit in ORBITS:
        made = start(f"henon-heiles:{orbit}")
        for label, (id, parameters) in methods.items():
            yield orbit, label, made, _run(made, id, HENON, t_end, **parameters)


def _henon_orbits(methods: Methods) -> list[dict]:
    rows = []
    for orbit, label, made, s in _henon(methods):
        inside = np.abs(s.q).max(axis=1) < 10 * ORBITS[orbit]  # an escaping orbit is cut off outside the frame
        path = _thin_path(s.q[inside][: round(DRAWN / HENON)])
        rows.append(row(orbit, label, *path.T, s, energy_error=_error(made, s).max()))
    return rows


def _henon_energies(methods: Methods) -> list[dict]:
    rows = []
    for orbit, label, made, s in _henon(methods):
        off = _error(made, s)
        rows.append(row(orbit, label, *_binned_maxima(s.t, off), s, energy_error=off.max()))
    return rows


def _section(problem: Problem, s: Solution) -> np.ndarray:
    """The Poincare section q1 = 0, p1 > 0 of a solution with H = |p|^2 / 2 + U(q): (q2, p2), array (n, 2)."""
    y = np.hstack([s.q[:, :2], s.p[:, 1:2]])
    rates = [*problem.system.dq[:2], problem.system.dp[1]]
    dy = np.stack([problem.system.observe(e, s.q, s.p) for e in rates], axis=1)
    i = np.flatnonzero((s.q[:-1, 0] < 0) & (s.q[1:, 0] >= 0))

    def at(x: np.ndarray) -> np.ndarray:
        """Hermite's cubic polynomial between two rows."""
        x = x[:, None]
        a, b = (1 + 2 * x) * (1 - x) ** 2, x * x * (3 - 2 * x)
        c, d = x * (1 - x) ** 2, x * x * (x - 1)
        return a * y[i] + b * y[i + 1] + s.h * (c * dy[i] + d * dy[i + 1])

    low, high = np.zeros(len(i)), np.ones(len(i))
    for _ in range(50):
        middle = (low + high) / 2
        before = at(middle)[:, 0] < 0
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return at((low + high) / 2)[:, 1:]


def _henon_sections() -> list[dict]:
    rows = []
    for orbit, label, made, s in _henon(SCHEME_I, LONG):
        crossings = _section(made, s)
        rows.append(row(orbit, label, *crossings.T, s, crossings=len(crossings)))
    return rows


def _precession(s: Solution) -> float:
    """The angle in radians by which the apocentre turns per revolution, on average."""
    r = np.hypot(*s.q.T)
    far = 1 + np.flatnonzero((r[1:-1] > r[:-2]) & (r[1:-1] >= r[2:]))
    if len(far) < 2:
        return float("nan")
    # The parabola through three distances locates the apocentre between rows.
    a, b, c = r[far - 1], r[far], r[far + 1]
    shift = 0.5 * (a - c) / (a - 2 * b + c)
    angle = np.unwrap(np.arctan2(s.q[:, 1], s.q[:, 0]))
    turned = angle[far] + shift * (angle[far + 1] - angle[far - 1]) / 2
    return float((turned[-1] - turned[0]) / (len(far) - 1) - 2 * np.pi)


def _kepler(chosen: tuple[str, dict], t_end: float = END) -> Solution:
    return _run(start("perturbed-kepler"), chosen[0], KEPLER, t_end, **chosen[1])


def _kepler_orbits(methods: Methods) -> list[dict]:
    rows = []
    for label, chosen in methods.items():
        s = _kepler(chosen)
        rows.append(row("", label, *_thin_path(s.q[: round(DRAWN / KEPLER)]).T, s, turn=_precession(s)))
    s = _run(start("perturbed-kepler"), "scheme-iii-suzuki-6", KEPLER / 2, END)
    return [*rows, row("", "exact flow", [], [], s, turn=_precession(s))]


def _kepler_invariants(methods: Methods, title: str = "") -> list[dict]:
    rows = []
    for label, chosen in methods.items():
        s = _kepler(chosen)
        for name in ("energy", "angular-momentum"):
            off = _error(start("perturbed-kepler"), s, name)
            rows.append(row(f"{title}{name}", label, *_binned_maxima(s.t, off), s, largest=off.max()))
    return rows


def _kepler_parameter() -> list[dict]:
    four, five = (_kepler(PRESERVING[label], 20.0) for label in ("Scheme IV", "Scheme V"))
    rows = [row("distance", "Scheme IV", four.t, np.hypot(*four.q.T), four)]
    for label, s in (("Scheme IV", four), ("Scheme V", five)):
        low, middle, high = (f(s.parameter) for f in (np.nanmin, np.nanmedian, np.nanmax))
        rows.append(row("lambda", label, s.t[1:], s.parameter, s, low=low, median=middle, high=high))
    return rows


#: Panel title -> (method id, order); curve label -> (method id, order).
SCHEMES = {"Scheme I": ("scheme-i", 1), "Scheme II": ("scheme-ii", 2), "Scheme III": ("scheme-iii", 2)}
COMPOSITIONS = {
    "III, Yoshida 4": ("scheme-iii-yoshida-4", 4),
    "III, Suzuki 4": ("scheme-iii-suzuki-4", 4),
    "V, Yoshida 4": ("scheme-v-yoshida-4", 4),
    "V, Suzuki 4": ("scheme-v-suzuki-4", 4),
    "III, Yoshida 6": ("scheme-iii-yoshida-6", 6),
    "III, Suzuki 6": ("scheme-iii-suzuki-6", 6),
}
TABLE = [6 * 2**k for k in range(8)]


def _differences(panel: str, curve: str, id: str, steps: Sequence[int], **parameters: Any) -> dict:
    """Max |y_h - y_2h| over q and p at t = 1 on the chaotic orbit of Henon-Heiles, with numbers of steps that double.

    The order is the log-log slope over the three smallest h with differences above `NOISE`.
    """
    made = start("henon-heiles:chaotic")
    runs = [integrate(made, id, t_end=1.0, steps=n, save_every=0, parameters=parameters) for n in steps]
    ends = [end_state(s) + (0 if s.status == "ok" else np.nan) for s in runs]
    h, off = 1.0 / np.array(steps[1:]), np.abs(np.diff(ends, axis=0)).max(axis=1)
    clear = off > NOISE
    line = np.polyfit(np.log(h[clear][-3:]), np.log(off[clear][-3:]), 1) if clear.sum() > 1 else [np.nan]
    worst = next((s for s in runs if s.status != "ok"), runs[-1])
    counts = {k: sum(s.counts[k] for s in runs) for k in ("steps", "fallbacks")}
    return row(panel, curve, h, off, worst) | counts | {"order": float(line[0])}


def _convergence() -> list[dict]:
    every = [(title, id, lam) for title, (id, _) in SCHEMES.items() for lam in variants.LAMBDAS]
    return [_differences(title, f"λ = {lam}", id, TABLE, lam=Fraction(lam)) for title, id, lam in every]


#: Figure -> the function that measures its curves, a row each.
FIGURES: dict[str, Callable[[], list[dict]]] = {
    "pendulum-area": _pendulum_area,
    "linear-symplectic-map": _linear_map,
    "lotka-volterra-flow": _lotka_flow,
    "lotka-volterra-methods": _lotka_methods,
    "henon-heiles-scheme-i-orbits": partial(_henon_orbits, SCHEME_I),
    "henon-heiles-scheme-i-sections": _henon_sections,
    "henon-heiles-scheme-i-energy": partial(_henon_energies, SCHEME_I),
    "henon-heiles-preserving-orbits": partial(_henon_orbits, PRESERVING),
    "henon-heiles-preserving-energy": partial(_henon_energies, PRESERVING),
    "perturbed-kepler-scheme-i-orbits": partial(_kepler_orbits, SCHEME_I),
    "perturbed-kepler-scheme-i-iii-invariants": lambda: [
        *_kepler_invariants(SCHEME_I, "Scheme I "),
        *_kepler_invariants(SCHEME_III, "Scheme III "),
    ],
    "perturbed-kepler-preserving-orbits": partial(_kepler_orbits, PRESERVING),
    "perturbed-kepler-preserving-invariants": partial(_kepler_invariants, PRESERVING),
    "perturbed-kepler-parameter": _kepler_parameter,
    "convergence-schemes-i-iii": _convergence,
    "convergence-preserving": lambda: [_differences("", t, id, TABLE) for t, (id, _) in PRESERVING.items()],
    "convergence-compositions": lambda: [
        _differences("", title, id, [2 * 2**k for k in range(10)]) for title, (id, _) in COMPOSITIONS.items()
    ],
}
