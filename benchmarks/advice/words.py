"""Command lines: the `phasebench integrate` command that runs a candidate and prints its error."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import Any

from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.problems.base import Problem

from .ask import Ask


def problem_arguments(problem: Problem, name: str | None = None) -> list[str] | None:
    """The command-line arguments that name a problem: an id or a file with its parameters, or a formula; or None."""
    from phasebench.benchmarks.problems import PROBLEMS
    from phasebench.benchmarks.problems import problem as registered

    usual = registered(problem.id).parameters if problem.id in PROBLEMS else {}
    if name is None and problem.id in PROBLEMS:
        name = problem.label
    if name is None:
        named_alone = getattr(problem, "bodies", None) is not None  # a formula has no quantities of bodies
        return formula(problem) if problem.system.canonical and not named_alone else None
    changed = {k: v for k, v in problem.parameters.items() if usual.get(k) != v}
    return [name, *(word for key, value in changed.items() for word in ("--set", f"{key}={value!r}"))]


def formula(problem: Problem) -> list[str]:
    """The arguments --hamiltonian, --q and --p of a canonical problem, H written in q, p or q1, p1, ..."""
    import sympy as sp

    system = problem.system
    d = system.d
    numbers = [""] if d == 1 else [str(i) for i in range(1, d + 1)]
    names = [sp.Symbol(f"{x}{i}") for x in "qp" for i in numbers]
    renamed = dict(zip((*system.q, *system.p), names, strict=True))
    H = str(system.H.xreplace(renamed))
    return ["--hamiltonian", H, "--q", format_numbers(problem.q0), "--p", format_numbers(problem.p0)]


def format_numbers(x: Sequence[float]) -> str:
    """The numbers in full precision, joined by commas."""
    return ",".join(repr(float(v)) for v in x)


def command(ask: Ask, integrator: Integrator, size: dict[str, Any], problem_words: Sequence[str] | None) -> str | None:
    """The command that runs an integrator at {"steps": n} or {"tol": x}; None if ``problem_words`` is None."""
    if problem_words is None:
        return None
    positional = [] if problem_words[0].startswith("--") else [problem_words[0]]
    options = list(problem_words[len(positional) :])
    words = ["phasebench", "integrate", *positional, integrator.id, *options]
    for key, value in integrator.record.parameters.items():
        words += ["--param", f"{key}={value}"]
    words += ["--steps", str(size["steps"])] if "steps" in size else ["--tol", repr(size["tol"])]
    words += ["--t-end", repr(ask.t_end)]
    words += ["--error"] if ask.quantity.name == "end-state" else ["--quantity", ask.quantity.name]
    return shlex.join(_join_negative_values(words))


def _join_negative_values(words: list[str]) -> list[str]:
    """Join ``--q -1`` to ``--q=-1``, so that a negative value is not read as an option."""
    joined_words: list[str] = []
    for word in words:
        negative = word[:1] == "-" and word[1:2] not in ("-", "")
        if negative and joined_words[-1].startswith("--"):
            joined_words[-1] += f"={word}"
        else:
            joined_words.append(word)
    return joined_words
