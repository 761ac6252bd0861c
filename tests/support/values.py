"""Values as kernels compute with them: tuples where they are compiled, arrays on plain NumPy."""

from __future__ import annotations

from phasebench.integrators.engine import kernel


def value(*components: float):
    """The value of so many components."""
    return kernel.value(components, len(components))
