"""Methods and problems, as their records declare them: pages without measurements."""

from __future__ import annotations

from functools import cache

import pandas as pd

from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Data, Table
from phasebench.benchmarks.page.study import Study
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import METHODS

#: Longer formulae are shortened.
LONGEST = 90


def count_methods(data: Data) -> str:
    """How many methods there are, and how many declare each property."""
    return (
        f"{len(METHODS)} methods of {len({m.family for m in METHODS})} families: "
        f"{sum(m.symplectic for m in METHODS)} are declared symplectic, {sum(m.symmetric for m in METHODS)} symmetric, "
        f"{sum(m.energy == ROUND_OFF for m in METHODS)} to keep the energy to round-off."
    )


def families(data: Data) -> Table:
    """The families of methods, and how many methods of each declare each property."""
    lines = []
    for family in dict.fromkeys(m.family for m in METHODS):
        members = [m for m in METHODS if m.family == family]
        orders = [str(p) for p in sorted({m.order for m in members})]
        line = {"family": family.replace("_", " "), "methods": len(members), "orders": join_list(orders, 12)}
        line |= {name: f"{sum(getattr(m, name) for m in members)}" for name in ("symplectic", "symmetric")}
        line["energy to round-off"] = f"{sum(m.energy == ROUND_OFF for m in members)}"
        lines.append(line | {"such as": join_list([m.id for m in members], 3)})
    caption = f"At most {ROWS} families, and how many of their methods declare each property; "
    return Table(pd.DataFrame(lines[:ROWS]), f"{caption}`phasebench list methods` names all.")


def methods(data: Data) -> pd.DataFrame:
    """What each method declares, and its source."""
    rows = [
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
    return pd.DataFrame(rows)


METHOD_PAGE = Study(
    id="methods",
    place=440,
    question="Which methods are there, and what does each declare?",
    answer=count_methods,
    setting=(
        "A method declares its family, order, symmetry, symplecticity and what becomes of the energy and of invariants "
        "q·Dp: kept to `round-off` on every step, `bounded` (the error oscillates) or `drift` (it grows).",
        "It also declares what it requires of a system: separable, quadratic kinetic energy, a Kepler part, ...",
        "Every declaration is tested on the pages [orders](orders.md), [structure](structure.md), [matrix](matrix.md) "
        "and [invariants](invariants.md); every method has a source and a citation (`phasebench cite`).",
    ),
    runs=(),
    claims={},
    shown=families,
    whole=methods,
    command="phasebench list methods",
    limits=("Schemes with a parameter λ keep invariants q·Dp at every λ, other quadratic ones at λ = 1/2 only.",),
)


@cache
def problems() -> tuple[Problem, ...]:
    """Every registered problem."""
    return tuple(map(problem, PROBLEMS))


def count_problems(data: Data) -> str:
    """How many problems and orbits there are, and of how many degrees of freedom."""
    sizes = [p.system.d for p in problems()]
    return (
        f"{len(sizes)} problems with {sum(len(p.orbits) for p in problems())} orbits, of {min(sizes)} to {max(sizes)} "
        f"degrees of freedom; {sum(bool(p.system.traits['separable']) for p in problems())} have H = T(p) + V(q)."
    )


def problem_table(data: Data) -> Table:
    """The problems with H and the number of their invariants."""
    lines = []
    for made in problems():
        line = {"problem": made.id, "d": made.system.d, "separable": "yes" if made.system.traits["separable"] else "no"}
        text = str(made.system.H)
        text = text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … (see its module)"
        line |= {"orbits": join_list([o.name for o in made.orbits], 4), "H (or invariant)": f"`{text}`"}
        lines.append(line | {"invariants": len(made.invariants)})
    caption = f"At most {ROWS} problems; `phasebench list problems` names all. `invariants` counts those beside the "
    return Table(pd.DataFrame(lines[:ROWS]), f"{caption}energy.")


def orbits(data: Data) -> pd.DataFrame:
    """The orbits of all problems with the first four numbers of their initial states."""

    def start(values: tuple[float, ...]) -> str:
        return ", ".join(map(repr, values[:4])) + (", …" if len(values) > 4 else "")

    pairs = [(made, o) for made in problems() for o in made.orbits]
    rows = [
        {"problem": p.id, "orbit": o.name, "q0": start(o.q), "p0": start(o.p), "source": p.source} for p, o in pairs
    ]
    return pd.DataFrame(rows)


PROBLEM_PAGE = Study(
    id="problems",
    place=441,
    question="Which problems are there, on which orbits?",
    answer=count_problems,
    setting=(
        "A problem is a system with published initial data, its invariants and a citation.",
        "d is the number of degrees of freedom; separable means H = T(p) + V(q).",
        "An orbit is named `problem:orbit`, as `henon-heiles:chaotic`; a problem's first orbit is its default.",
    ),
    runs=(),
    claims={},
    shown=problem_table,
    whole=orbits,
    command="phasebench list problems",
    limits=("Initial data are the doubles nearest to the published digits; references start from these doubles.",),
)
