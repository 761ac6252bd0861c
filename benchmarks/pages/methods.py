"""The methods and problems, from their records."""

from __future__ import annotations

import pandas as pd

from integrators.registry import METHODS

from ..markdown import table
from ..problems import PROBLEMS, problem
from .page import Page


def methods_frame() -> pd.DataFrame:
    """A row for each method's record."""
    return pd.DataFrame(
        {
            "method": m.id,
            "name": m.name,
            "order": m.order,
            "symmetric": "yes" if m.symmetric else "no",
            "symplectic": "yes" if m.symplectic else "no",
            "energy": m.energy,
            "q.D p": m.quadratic,
            "requires": ", ".join(m.requires),
            "parameters": ", ".join(f"{k}={v}" for k, v in m.parameters.items()),
            "source": m.source,
        }
        for m in METHODS
    )


def problems_frame() -> pd.DataFrame:
    """A row for each orbit of each problem."""
    out = []
    for id in PROBLEMS:
        made = problem(id)
        traits = made.system.traits
        for o in made.orbits:
            out.append(
                {
                    "problem": f"{id}:{o.name}" if len(made.orbits) > 1 else id,
                    "name": made.name,
                    "d": made.system.d,
                    "separable": "yes" if traits["separable"] else "no",
                    "H or invariant": str(made.system.H),
                    "q0": str(list(o.q)),
                    "p0": str(list(o.p)),
                    "other invariants": ", ".join(made.invariants),
                    "source": made.source,
                }
            )
    return pd.DataFrame(out)


def _write(data, figures):
    body = [
        "How well a method keeps the energy, and invariants of the form q.D p (linear and angular momentum): `round-off`, "
        "`bounded` (oscillates) or `drift`. The parameterized schemes keep general quadratic invariants only at lambda = 1/2; "
        "those of the form q.D p at every lambda.\n",
        "## Methods\n",
        table(methods_frame()),
        "## Problems\n",
        table(problems_frame()),
    ]
    return [f"{len(METHODS)} methods and {len(PROBLEMS)} problems are registered."], "\n".join(body)


PAGE = Page("methods", "Methods and problems", "what each method is and requires, what each problem is", (), _write)
