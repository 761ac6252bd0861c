"""Compute end states of short runs of every method without compilation: ``python plain.py`` prints JSON.

``python tests/support/plain.py --record`` stores them anew in `STORED` and shows what changed.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

if __name__ == "__main__":
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from phasebench.benchmarks.measure.battery import SYSTEMS, by_label, runs_on, variants
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import Method
from support.one_of_each import kinds

STORED = Path(__file__).parents[1] / "integrators" / "end_states.json"
H, STEPS = 0.02, 20
#: One lambda only: its value does not affect compilation.
METHODS = by_label(variants(lam=(Fraction(1, 3),), order=(1, 2)))
KINDS = kinds(METHODS.values())
#: A separable and a non-separable system; other tests compile the same kernels, d being equal.
NAMES = ("henon-heiles", "coupled")
#: Relative to the larger of 1 and the state.
ROUND_OFF = 1e-12

#: System -> (status, end state (q, p)).
Ends = dict[str, tuple[str, list[float]]]


def systems_for(m: Method) -> list[str]:
    """The names of at most two systems on which the method m runs here."""
    return [name for name in dict.fromkeys([*NAMES, *SYSTEMS]) if runs_on(m, name)][: len(NAMES)]


def ends(m: Method, names: Sequence[str] = ()) -> Ends:
    """Run a method on some or all of its systems; if a run raises, its status is the exception's text."""
    out = {}
    for name in names or systems_for(m):
        system, q, p = SYSTEMS[name]()
        try:
            with np.errstate(all="ignore"):
                s = integrate(system, m, h=H, steps=STEPS, q0=q, p0=p)
        except Exception as error:  # an exception fails the test of this method only
            out[name] = (f"{type(error).__name__}: {error}", [])
            continue
        out[name] = (s.status, [float(x) for x in (*s.q[-1], *s.p[-1])])
    return out


def apart(one: Ends, other: Ends) -> list[str]:
    """Say where the ends of two runs of a method differ by more than round-off."""
    said = [f"it runs on {[*one]}, not {[*other]}"] if {*one} != {*other} else []
    for name in {*one} & {*other}:
        (status, x), (known, y) = one[name], other[name]
        if status != known or len(x) != len(y):
            said.append(f"on {name}: {status}, not {known}")
        elif (far := np.abs(np.subtract(x, y)).max(initial=0)) > ROUND_OFF * max(1, np.abs(y).max(initial=0)):
            said.append(f"on {name}: {far:.1e} away")
    return said


def stored() -> dict[str, Ends]:
    """The stored end states, by method."""
    return json.loads(STORED.read_text()) if STORED.exists() else {}


if __name__ == "__main__":
    from phasebench.integrators.compile.codegen import compiled

    assert not compiled(), "this process compiles"
    found = {label: ends(m) for label, m in METHODS.items()}
    if "--record" in sys.argv:
        before = stored()
        for label in {**before, **found}:
            print(*(f"{label} {what}\n" for what in apart(found.get(label, {}), before.get(label, {}))), sep="", end="")
        STORED.write_text("{\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in found.items()) + "\n}\n")
    else:
        print(json.dumps({"result": found}))
