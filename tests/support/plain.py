"""End states of short runs, for a process with NUMBA_DISABLE_JIT=1: ``python plain.py`` prints JSON."""

from __future__ import annotations

import json
import re
from fractions import Fraction

import numpy as np

from phasebench.benchmarks.measure.battery import SYSTEMS, runs_on, variants
from phasebench.integrators.driver import integrate

H, STEPS = 0.02, 12
#: One lambda each: to be compiled or not is a matter of kernels and generated functions, which lambda does not change.
METHODS = variants(lam=(Fraction(1, 3),), order=(1, 2))
#: A separable and a non-separable one, of as many degrees of freedom as other tests have kernels compiled for.
NAMES = ("henon-heiles", "coupled")
#: Methods of this many nodes stand for their kind on the second system: more nodes are another kernel to compile there.
FEWEST = {"gauss": "gauss-2", "hbvm": "hbvm-4-2", "gauss-equip": "gauss-equip-2"}


def chosen(m) -> list[str]:
    """The systems on which a method runs here: of those that differ in the number of nodes one runs on the second."""
    kind = re.sub(r"(-\d+)+$", "", m.id)
    return [n for n in NAMES if runs_on(m, n) and (n == NAMES[0] or FEWEST.get(kind, m.id) == m.id)]


def end_states():
    """{label: {system: [status, state at the end]}}; numbers as hexadecimal text, so that none is rounded."""
    out = {}
    for m in METHODS:
        out[m.label] = {}
        for name in chosen(m):
            system, q, p = SYSTEMS[name]()
            try:
                with np.errstate(all="ignore"):
                    s = integrate(system, m, h=H, steps=STEPS, q0=q, p0=p)
            except Exception as error:  # one method that fails is to fail its own test alone
                out[m.label][name] = [f"{type(error).__name__}: {error}", []]
                continue
            out[m.label][name] = [s.status, [float(x).hex() for x in (*s.q[-1], *s.p[-1])]]
    return out


if __name__ == "__main__":
    from phasebench.integrators.engine.codegen import compiled

    assert not compiled(), "this process compiles"
    print(json.dumps({"result": end_states()}))
