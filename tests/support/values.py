"""State vectors as the compiled step loops (kernels) use them: tuples if compiled, arrays on plain NumPy."""

from __future__ import annotations

from phasebench.integrators.stepping import kernel


def value(*components: float):
    """Return the state vector with these components, of the type that the compiled step loops (kernels) use."""
    return kernel.value(components, len(components))
