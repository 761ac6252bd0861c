"""Generate a page for each problem: H, orbits, invariants, scenes (spans with steps or accuracies), source."""

from __future__ import annotations

import importlib

import sympy as sp
from pages import Files, bibtex, citations, code, facts, fenced, fold, plain, table, toctree

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.benchmarks.problems.scenes import SCENES

#: Terms of H up to which the formula is printed, and components up to which a state is.
TERMS, COMPONENTS = 24, 4
#: Traits that say nothing of the problem.
UNUSED = ("Poisson structure", "elementary derivatives", "polynomial degree")


def files() -> Files:
    """The pages of the problems and their index: file name -> Markdown."""
    found = {id: problem(id) for id in PROBLEMS}
    pages = {f"problems/{id}.md": page(made) for id, made in found.items()}
    rows = [
        {
            "problem": f"[{id}]({id}.md)",
            "name": plain(made.name),
            "degrees of freedom": made.system.d,
            "orbits": ", ".join(orbit.name for orbit in made.orbits),
            "traits": ", ".join(traits(made)),
        }
        for id, made in found.items()
    ]
    pages["problems/index.md"] = f"# Problems\n\n{table(rows)}\n{toctree(list(found))}"
    return pages


def traits(made: Problem) -> list[str]:
    """The names of the traits of a problem's system, such as "separable", that methods can require."""
    found = made.system.traits.items()
    return [name for name, value in found if value and name not in UNUSED]


def page(made: Problem) -> str:
    """The page of a problem, as Markdown."""
    module = importlib.import_module(f"phasebench.benchmarks.problems.{PROBLEMS[made.id][0]}")
    about = (module.__doc__ or "").strip().splitlines()[0]
    parts = [
        f"# {made.id}\n",
        plain(about) + "\n",
        facts(
            {
                "Degrees of freedom": str(made.system.d),
                "Traits": ", ".join(traits(made)),
                "Parameters": ", ".join(code(f"{k}={v:g}") for k, v in made.parameters.items()),
                "Unit of time": made.time_unit,
                "Source": f"{plain(made.source)} {citations(made.cite)}",
            }
        ),
        "## Hamiltonian\n",
        hamiltonian(made),
        "## Orbits\n",
        table(_orbit(made, orbit) for orbit in made.orbits),
    ]
    if made.invariants:
        parts += ["## Invariants besides H\n", invariants(made)]
    parts += ["## Scenes\n", scenes(made), "## Run it\n"]
    parts += [
        fenced(
            f"phasebench integrate {made.label} implicit-midpoint --t-end {made.pace.span:g} "
            f"--steps {max(1, round(made.pace.span / made.pace.step))}"
        )
    ]
    return "\n".join([*parts, "## How to cite it\n", bibtex(made.cite)])


def hamiltonian(made: Problem) -> str:
    """H as Markdown with LaTeX; of more than `TERMS` terms their number and the first three."""
    terms = sp.Add.make_args(made.system.H)
    if len(terms) > TERMS:
        return f"H is a sum of {len(terms)} terms, of which these are the first:\n\n" + _math(
            sp.Add(*terms[:3]), r"\dots + "
        )
    return _math(made.system.H, "H = ")


def _math(expression: sp.Expr, before: str) -> str:
    return f"```{{math}}\n{before}{sp.latex(expression, mul_symbol=' ')}\n```\n"


def invariants(made: Problem) -> str:
    """A Markdown table of the invariants besides H, each with its name and its formula in LaTeX unless that is long."""
    rows = []
    for name, expression in made.invariants.items():
        short = len(sp.Add.make_args(sp.sympify(expression))) <= TERMS // 2
        rows.append({"name": name, "formula": f"${sp.latex(sp.sympify(expression))}$" if short else "a longer sum"})
    text = table(rows)
    return fold(f"{len(rows)} invariants", text) if len(rows) > TERMS else text


def _orbit(made: Problem, orbit) -> dict[str, str]:
    return {
        "orbit": orbit.name,
        "about": plain(orbit.about),
        "q": _state(orbit.q),
        "p": _state(orbit.p),
        "certified at t =": ", ".join(f"{t:g}" for t in orbit.times),
    }


def _state(x) -> str:
    """The components of a coordinate or momentum vector in full precision, or, if they are many, only their number."""
    return ", ".join(code(repr(float(v))) for v in x) if len(x) <= COMPONENTS else f"{len(x)} numbers"


def scenes(made: Problem) -> str:
    """A Markdown table of the scenes on a problem: its spans with the steps at which orders and drifts are measured.

    Those of the trade (costs at equal error) follow, with their quantity and accuracies.
    """
    rows = [
        {"scene": s.id, "purpose": s.purpose, "t": number(s.t_end), "what": f"h from {s.steps[0]:g} to {s.steps[-1]:g}"}
        for s in SCENES
        if s.problem.partition(":")[0] == made.id
    ]
    rows += [
        {
            "scene": f"[{q.id}](../reports/trade-{q.id}.md)",
            "purpose": "trade",
            "t": number(q.t_end),
            "what": f"{q.quantity} to errors of {q.accuracies[0]:g} to {q.accuracies[-1]:g}: {q.about}",
        }
        for q in QUESTIONS
        if q.problem.partition(":")[0] == made.id
    ]
    return table(rows)
