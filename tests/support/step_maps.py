"""Made-up step maps on the oscillator, for tests of stability intervals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def of_trace(trace: Callable[[float], float]) -> Callable[[float], np.ndarray]:
    """A symplectic map, z -> matrix, with the trace ``trace(z)``."""
    return lambda z: np.array([[trace(z), -1.0], [1.0, 0.0]])
