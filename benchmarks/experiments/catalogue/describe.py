"""The table of methods that ``list methods`` and the report show, made from the methods' records."""

from __future__ import annotations

from phasebench.integrators.registry import METHODS


def methods() -> list[dict[str, str]]:
    """Make a row (column -> text) for each integration method: order, properties, requirements, parameters, source."""
    return [
        {
            "method": m.id,
            "name": m.name,
            "order": str(m.order),
            "symmetric": "yes" if m.symmetric else "no",
            "symplectic": "yes" if m.symplectic else "no",
            "energy": m.energy,
            "q.D p": m.quadratic,
            "requires": ", ".join(m.requires) or "-",
            "parameters": ", ".join(f"{k}={v}" for k, v in m.parameters.items()) or "-",
            "source": m.source,
            "cite": ", ".join(m.cite),
        }
        for m in METHODS
    ]
