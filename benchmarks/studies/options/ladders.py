"""Options that change the step map: for each setting, the error at the end against time, over ever smaller steps.

- composition order: symmetric compositions of Stormer-Verlet of order 2 to 10;
- generating function: the order r, at the parameter lambda = 1/3, and at 1/2, where an odd r gives the order r + 1;
- energy: methods that keep the energy to round-off: Schemes IV and V (methods that are symplectic at a fixed
  parameter, which is chosen in each step to keep H) and compositions of them, projection, relaxation.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from phasebench.benchmarks.measure.quantities import scale
from phasebench.benchmarks.measure.timing import columns, median, time_in_turns
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method
from phasebench.reference.certificates import stored

#: Rounds of timing, and rows of a run from which its energy error is computed.
TABLE, ROUNDS, ROWS = "knobs_ladders", 7, 200
COMPOSITION, GENERATING, ENERGY = "composition order", "generating function", "energy"
#: (Option, orbit) -> end time, at which there is a certified state, fewest steps, how many numbers of steps.
LADDERS = {
    (COMPOSITION, "henon-heiles:box"): (100.0, 30, 19),
    (COMPOSITION, "perturbed-kepler"): (10.0, 20, 19),
    (GENERATING, "pendulum:swinging"): (100.0, 100, 14),
    (GENERATING, "lotka-volterra-log:4-2"): (12.0, 40, 14),
    (ENERGY, "henon-heiles:box"): (100.0, 60, 14),
    (ENERGY, "perturbed-kepler"): (10.0, 60, 14),
}
KEYS = [{"knob": option, "scene": scene} for option, scene in LADDERS]
COMPOSITIONS = ("stormer-verlet", "suzuki-4", "kahan-li-6", "kahan-li-8", "sofroniou-spaletta-10")
#: Settings of generating functions -> r, lambda.
ORDERS = {f"r = {r}, λ = 1/3": (r, "1/3") for r in range(1, 7)} | {f"r = {r}, λ = 1/2": (r, "1/2") for r in (1, 3, 5)}
KEEPERS = (
    *("scheme-iv", "scheme-v", "scheme-v-suzuki-4", "scheme-v-kahan-li-6", "rk4-projected-energy"),
    *("stormer-verlet-symmetric-projection", "suzuki-4-symmetric-projection", "rk4-relaxation", "dop853-relaxation"),
)
#: Option -> setting -> the method with that setting.
SETTINGS = {
    COMPOSITION: {str(method(id).order): method(id) for id in COMPOSITIONS},
    GENERATING: {name: method("generating-function", order=r, lam=lam) for name, (r, lam) in ORDERS.items()},
    ENERGY: {id: method(id) for id in KEEPERS},
}


def ladders(knob: str, scene: str) -> list[dict]:
    """Error and time of each setting with each number of steps; failed runs have no time.

    The error is that of the end against the certified state, the energy error the largest over the run; times are those
    of prepared runs, in turns.
    """
    made, (t_end, fewest, rungs) = problem_of(scene), LADDERS[knob, scene]
    end, rows, work = stored.end(made, t_end), [], {}
    for name, record in SETTINGS[knob].items():
        run = prepare(made, record)
        for steps in (round(fewest * 2 ** (k / 2)) for k in range(rungs)):
            h = t_end / steps
            s = integrate(made, record, h=h, steps=steps, save_every=max(1, steps // ROWS))
            with np.errstate(all="ignore"):
                H = made.system.observe(made.system.H, s.q, s.p)
                energy = float(np.abs(H - H[0]).max()) / scale(made)
                error = float(np.abs(np.concatenate([s.q[-1] - end.q, s.p[-1] - end.p])).max())
            row = {"setting": name, "method": record.label, "h": h, "steps": steps, "status": s.status}
            row |= {"error": error if s.status == OK else None, "energy error": energy}
            row |= {"gradients": s.counts["gradient"], "fallbacks": s.counts["fallbacks"]}
            rows.append(row | {"uncertainty": float(end.uncertainty)})
            if s.status == OK:
                work[len(rows) - 1] = partial(run, h, steps)
    for k, seconds in time_in_turns(work, ROUNDS).items():
        rows[k] |= columns("us", median(1e6 * seconds))
    return rows
