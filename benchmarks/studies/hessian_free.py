r"""The energy of Hessian-free force-gradient methods on chaotic and on regular orbits, beside those with the Hessian.

A Hessian-free method replaces the gradient of the squared force in a kick by a second evaluation of the force.  Its
steps are symmetric and keep the volume but are not symplectic, so that no theorem bounds the energy.  On chaotic orbits
of

.. math:: H = \tfrac12 |p|^2 + \tfrac12 x^2 y^2 + \tfrac1{40}(x^4 + y^4) = 1

the change of the energy is its mean over the last tenth less its mean over the first tenth.  Orbits from random starts
are independent: the mean of their changes, divided by the time between, is the drift, with Student's interval; the
standard deviation of the changes is the spread.  On a regular orbit the drift is the slope of the energy over time.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Shown, Study, over
from phasebench.benchmarks.page.verdict import EVERY, at_least, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.driver import integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.systems.hamiltonian import Hamiltonian

CHAOTIC, REGULAR, PARTNER = "hessian_free_chaotic", "hessian_free_regular", "with the Hessian"
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
#: Share of intervals to hold zero; largest change in oscillations; largest spread over that with the Hessian.
LEAST, STILL, SAME = 0.85, 1e-6, 2.0


def starts(system: Hamiltonian, n: int = ORBITS) -> tuple[np.ndarray, np.ndarray]:
    """``n`` random states (q, p), arrays (n, 2), of the energy 1."""
    generator = np.random.default_rng(SEED)
    Q, angle = generator.uniform(-1, 1, (n, 2)), generator.uniform(0, 2 * np.pi, n)
    speed = np.sqrt(2 * (1 - system.energies(Q, 0 * Q)))
    return Q, speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def student(x: np.ndarray) -> tuple[float, float, float]:
    """(Mean, low, high): the mean of independent numbers and its 95 % interval by Student's t."""
    from scipy.stats import t

    half = t.ppf(0.975, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x))
    return float(x.mean()), float(x.mean() - half), float(x.mean() + half)


def chaotic(method: str, steps: int | None = None) -> dict:
    """The drift of the energy on `ORBITS` chaotic orbits, its spread, and the largest |H - H0| (``oscillation``)."""
    steps = steps or (STEPS // EARLIER if method == CONTROL else STEPS)
    system = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + x**2*y**2/2 + (x**4 + y**4)/40")
    every = steps // ROWS
    found = integrate_ensemble(system, method, *starts(system), h=H, steps=every * ROWS, save_every=every, threads=1)
    E = np.array([system.energies(q, p) for q, p in zip(found.Q, found.P, strict=True)])
    tenth = ROWS // 10
    changes = E[:, -tenth:].mean(axis=1) - E[:, 1 : tenth + 1].mean(axis=1)
    between = 0.9 * H * every * ROWS
    mean, low, high = (x / between for x in student(changes))
    return {
        PARTNER: WITH.get(method, ""),
        "h": H,
        "orbits": len(E),
        "failed": int((found.status != "ok").sum()),
        "drift": mean,
        "low": low,
        "high": high,
        "change": mean * between,
        "spread": float(changes.std(ddof=1)),
        "oscillation": float(np.abs(E - E[:, :1]).max()),
    }


def regular(method: str, problem: str) -> dict:
    """The drift of the energy on a regular orbit, its size times the span (``change``), and the largest |H - H0|."""
    made, h = problem_of(problem), ORBIT_STEPS[problem]
    s = integrate(made, method, h=h, steps=REGULAR_STEPS, save_every=REGULAR_STEPS // REGULAR_ROWS)
    E = made.system.energies(s.q, s.p)
    slope = drift(s.t, E - E[0])
    row = {"method": method, PARTNER: WITH.get(method, ""), "problem": problem, "h": h, "status": s.status}
    row |= {"drift": slope.value, "low": slope.low, "high": slope.high}
    return row | {"change": abs(slope.value) * s.t[-1], "oscillation": float(np.abs(E - E[0]).max())}


FREE, HOLDS = f"`{PARTNER}` == `{PARTNER}`", "low <= 0 <= high"  # it is not missing; the interval holds zero


def ratios(rows: pd.DataFrame) -> pd.Series:
    """The spread of each Hessian-free method over that of its partner, by method."""
    spread, free = rows.set_index("method")["spread"], rows.query(FREE).set_index("method")
    return (free["spread"] / free[PARTNER].map(spread)).dropna()


@picture(
    CHAOTIC, "hessian_free", "changes of the energy",
    f"Mean change of the energy of {ORBITS} chaotic orbits over a run, in units of the spread with the Hessian, with "
    "95 % intervals; the axis is linear between −1 and 1.",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure:
    rows, by = frame.query(FREE), frame.set_index("method")
    rows = rows[rows[PARTNER].isin(frame["method"])]
    unit = rows[PARTNER].map(by["spread"]).to_numpy()
    figure, ((axes,),) = style.panels(1, 1, 3.0)
    for k, label in enumerate(("without the Hessian", PARTNER)):
        at = rows if k == 0 else by.loc[rows[PARTNER]].reset_index()
        scale = at["change"].abs().to_numpy() / at["drift"].abs().to_numpy() / unit
        half = (at["high"] - at["low"]).to_numpy() / 2 * scale
        place = [i + 0.15 * (2 * k - 1) for i in range(len(rows))]
        look = {"fmt": "o", "color": (style.ORANGE, style.BLUE)[k], "label": label}
        axes.errorbar(at["drift"].to_numpy() * scale, place, xerr=half, **look)
    axes.axvline(0, color="0.7", linewidth=0.8)
    axes.set_yticks(range(len(rows)), rows["method"])
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlabel("mean change of the energy over the run / spread with the Hessian")
    style.legend_above(figure, axes, 2)
    return figure


STUDY = Study(
    id="hessian_free",
    place=340,
    question="Does the energy of Hessian-free force gradients drift?",
    answer="{drifting.n} of {drifting.of} Hessian-free methods show a linear energy drift; on chaotic orbits energies "
    "spread up to {spreads.high} times as far as with the Hessian ({spreads.where}).",
    setting=(
        "A Hessian-free kick takes a second force at q − (2 c h²/b) M⁻¹∇V, b and c its weights: symmetric, "
        "volume-preserving, not symplectic.",
        f"Chaotic: H = |p|²/2 + x²y²/2 + (x⁴ + y⁴)/40 = 1, {ORBITS} random starts, h = {H:g}, {STEPS} steps; last "
        "tenth less first tenth.",
        f"Regular: {', '.join(ORBIT_STEPS)}, {REGULAR_STEPS} steps; the slope of the energy without its oscillation.",
        "Each is compared with a method of the same drifts and kicks that has the Hessian and is symplectic.",
        "Of chaotic orbits the mean change is the drift; the standard deviation between orbits is the spread.",
    ),
    runs=(
        Runs(CHAOTIC, chaotic, over(method=(*METHODS, CONTROL))),
        Runs(REGULAR, regular, [{"method": m, "problem": p} for m in METHODS for p in ORBIT_STEPS]),
    ),
    claims={
        "drifts": Claim(
            "On chaotic orbits the interval of a Hessian-free energy drift holds zero",
            CHAOTIC, HOLDS, at_least(LEAST), rows=FREE, unit="methods",
        ),
        "symplectic": Claim(
            "On chaotic orbits the drift's interval holds zero with the Hessian, too",
            CHAOTIC, HOLDS, at_least(LEAST), rows=f"`{PARTNER}` != `{PARTNER}` and method != '{CONTROL}'",
            unit="methods",
        ),
        "control": Claim(
            "The drift of a Runge–Kutta method is seen: its interval excludes zero",
            CHAOTIC, f"not ({HOLDS})", EVERY, rows=f"method == '{CONTROL}'", unit="methods",
            where=lambda rows: CONTROL, fault=True,
        ),
        "spreads": Claim(
            "Energies of chaotic orbits spread no further without the Hessian",
            CHAOTIC, ratios, at_most(SAME), unit="times the spread with it", span=True,
        ),
        "regular": Claim(
            "On regular orbits the Hessian-free energy does not drift",
            REGULAR, "change / oscillation", at_most(STILL), rows=FREE, unit="of its oscillation",
        ),
    },
    numbers={"drifting": Claim("The energy drifts", CHAOTIC, f"not ({HOLDS})", rows=FREE)},
    checks={
        "whole": Claim("Every chaotic orbit is integrated to its end", CHAOTIC, "failed == 0"),
        "ended": Claim("Every regular orbit is integrated to its end", REGULAR, "status == 'ok'"),
    },
    figure=_draw,
    shown=Shown(
        CHAOTIC,
        ("method", PARTNER, "drift", "low", "high", "spread", "oscillation"),
        "Chaotic orbits, H = 1: drift per unit of time, its 95 % interval; spread over a run; largest |H − H₀|.",
    ),
    whole=REGULAR,
    limits=(
        "The partner with the Hessian has the same structure, but for most methods slightly other numbers.",
        f"Of seven 95 % intervals one may miss zero by chance: {LEAST:.0%} are asked for.",
        f"A regular energy drifts if it changes by more than {STILL:g} of its oscillation; up to {SAME:g} times the "
        "partner's spread counts as no further.",
        f"{CONTROL}, the control, makes one step in {EARLIER}: after all of them it has lost most of its energy.",
        "One system, one step size: a longer run or step may show a drift that these intervals hide.",
    ),
    within="sampling",
)  # fmt: skip
