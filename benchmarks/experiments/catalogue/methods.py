"""The methods and problems, from their records."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import table
from phasebench.benchmarks.page.page import Page
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators.registry import METHODS

from . import describe

#: Longer formulae and states are not printed: their module has them.
LONGEST, MOST = 240, 6


def _formula(H) -> str:
    text = str(H)
    return text if len(text) <= LONGEST else f"{text[:60]} ... (see the module)"


def _state(x) -> str:
    shown = ", ".join(map(repr, x[:MOST]))
    return f"[{shown}]" if len(x) <= MOST else f"[{shown}, ... {len(x)} in all]"


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
                    "H or invariant": _formula(made.system.H),
                    "q0": _state(o.q),
                    "p0": _state(o.p),
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
        "The works are in `integrators/bibliography.bib` and `benchmarks/problems/bibliography.bib`; `phasebench cite` prints "
        "those of the methods and problems of a report.\n",
        "## Methods\n",
        table(pd.DataFrame(describe.methods())),
        "## Problems\n",
        table(problems_frame()),
    ]
    return [f"{len(METHODS)} methods and {len(PROBLEMS)} problems are registered."], "\n".join(body)


PAGE = Page("methods", "Methods and problems", "what each method is and requires, what each problem is", (), _write)
