"""Compare step matrices on the harmonic oscillator with the exact ones of the methods' formulas; prints JSON."""

from __future__ import annotations

import json

import mpmath
import numpy as np

from phasebench.benchmarks.measure import exact_maps, oscillator
from phasebench.benchmarks.measure.integrator import integrator

KNOWN = ["scheme-ii", "generating-function", *sorted({*exact_maps.SAME} - {"avf"})]
H = 0.3


def of(id: str) -> float:
    """Return the largest difference of a method's step matrix on the oscillator from the exact matrix of its formula.

    ``id`` is the method's; the step is `H`.
    """
    with mpmath.workdps(exact_maps.DIGITS):
        exact = np.array(exact_maps.exact_matrix(id, {}, H).tolist(), float)
    return float(np.abs(exact - oscillator.matrix(integrator(id), H)).max())


if __name__ == "__main__":
    print(json.dumps({"result": {id: of(id) for id in KNOWN}}))
