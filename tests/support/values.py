"""State vectors as kernels use them: tuples if compiled, arrays on plain NumPy."""

from __future__ import annotations

from phasebench.integrators.stepping import kernel


def value(*components: float):
    """The state vector with these components, of the type that kernels use."""
    return kernel.value(components, len(components))
