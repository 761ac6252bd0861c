"""State vectors as kernels use them: tuples if compiled, arrays on plain NumPy."""

from __future__ import annotations

from phasebench.integrators.stepping import kernel


def value(*components: float):
    """The vector with these components."""
    return kernel.value(components, len(components))
