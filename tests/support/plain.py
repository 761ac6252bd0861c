"""Compute end states of short runs of every method without compilation: ``python plain.py`` prints JSON.

It needs a process with NUMBA_DISABLE_JIT=1.
"""

from __future__ import annotations

import json
import re
from fractions import Fraction

import numpy as np

from phasebench.benchmarks.measure.battery import SYSTEMS, runs_on, variants
from phasebench.integrators.driver import integrate

H, STEPS = 0.02, 12
#: One lambda only: its value does not affect compilation.
METHODS = variants(lam=(Fraction(1, 3),), order=(1, 2))
#: A separable and a non-separable system; other tests compile the same kernels, d being equal.
NAMES = ("henon-heiles", "coupled")
#: On the second system one number of nodes stands for its kind of method, as each number needs another kernel.
FEWEST = {"gauss": "gauss-2", "hbvm": "hbvm-4-2", "gauss-equip": "gauss-equip-2"}


def systems_for(m) -> list[str]:
    """Return the names of the systems, of `NAMES`, on which the method m runs here.

    Of methods that differ only in their number of quadrature nodes, one runs on the second system.
    """
    kind = re.sub(r"(-\d+)+$", "", m.id)
    return [n for n in NAMES if runs_on(m, n) and (n == NAMES[0] or FEWEST.get(kind, m.id) == m.id)]


def end_states():
    """Run every method on its systems: {method's label: {system's name: [status, end state (q, p)]}}.

    Numbers are texts in hexadecimal, which is exact; if a run raises, the status is the exception's text.
    """
    out = {}
    for m in METHODS:
        out[m.label] = {}
        for name in systems_for(m):
            system, q, p = SYSTEMS[name]()
            try:
                with np.errstate(all="ignore"):
                    s = integrate(system, m, h=H, steps=STEPS, q0=q, p0=p)
            except Exception as error:  # an exception fails the test of this method only
                out[m.label][name] = [f"{type(error).__name__}: {error}", []]
                continue
            out[m.label][name] = [s.status, [float(x).hex() for x in (*s.q[-1], *s.p[-1])]]
    return out


if __name__ == "__main__":
    from phasebench.integrators.compile.codegen import compiled

    assert not compiled(), "this process compiles"
    print(json.dumps({"result": end_states()}))
