"""``cache``: show, clear or fill the cache of generated sources and compiled kernels."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from typing import Annotated

import typer

from . import options
from .shared import WRONG, err, out, print_json

#: Systems of up to this many degrees of freedom are compiled ahead.
LARGEST = 4


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove every entry, of all versions.")] = False,
    build: Annotated[
        bool,
        typer.Option("--build", help=f"Compile all methods for all problems of up to {LARGEST} degrees of freedom."),
    ] = False,
    jobs: Annotated[int, options.jobs("For --build; 0: as many as there are cores.")] = 0,
    as_json: options.Json = False,
) -> None:
    """Show where compiled code is cached and how much there is; --clear removes it, --build compiles it ahead."""
    from phasebench.integrators.compile import cache as kept

    if clear:
        kept.clear()
    failed = _build(jobs, not as_json) if build else []
    for problem in failed:
        err.print(problem, highlight=False, soft_wrap=True)
    if as_json:
        print_json(_state())
    else:
        _print(_state())
    raise typer.Exit(WRONG if failed else 0)


def _state() -> dict[str, object]:
    from phasebench.integrators.compile import cache as kept

    own = kept.folder()
    sizes = {place: kept.size(place) for place in kept.versions()}
    entries, used = sizes.pop(own, (0, 0))
    return {
        "folder": None if kept.root() is None else str(kept.root()),
        "version": kept.version(),
        "entries": entries,
        "bytes": used,
        "other_versions": len(sizes),
        "other_bytes": sum(size for _, size in sizes.values()),
        "bound": kept.MAX_BYTES,
    }


def _print(state: dict) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None)
    table.add_row("folder", Text(state["folder"] or "none: the platform names none"))
    table.add_row("this version", f"{state['entries']} entries, {state['bytes'] / 1e6:.1f} MB ({state['version']})")
    table.add_row("other versions", f"{state['other_versions']}, {state['other_bytes'] / 1e6:.1f} MB")
    table.add_row("bound", f"{state['bound'] / 1e6:.0f} MB; above it the longest unused goes")
    out.print(table, highlight=False)


# -- built ahead -------------------------------------------------------------------------------------------------------


def tasks() -> list[tuple[str, int, tuple[str, ...]]]:
    """The compilations of --build: (family, degrees of freedom d, problems of that d); no two share a kernel."""
    from phasebench.benchmarks.problems import PROBLEMS, problem
    from phasebench.integrators import METHODS

    by_size: dict[int, list[str]] = defaultdict(list)
    for name in PROBLEMS:
        by_size[problem(name).system.d].append(name)
    families = dict.fromkeys(m.family for m in METHODS)
    return [(f, d, tuple(by_size[d])) for d in range(LARGEST, 0, -1) if by_size[d] for f in families]


def made(task: tuple[str, int, tuple[str, ...]]) -> tuple[int, list[str]]:
    """Compile a task of `tasks`; return (number of methods compiled for problems, texts of the failures)."""
    from phasebench.benchmarks.problems import problem
    from phasebench.integrators import METHODS
    from phasebench.integrators.driver import warm

    family, _, names = task
    done, failures = 0, []
    for name in names:
        whole = problem(name)
        for method in METHODS:
            if method.family != family or method.lacks(whole.system) is not None:
                continue
            try:
                warm(whole, method, h=1e-3, steps=1)
                done += 1
            except Exception as error:  # the others are compiled all the same
                failures.append(f"{method.id} on {name}: {type(error).__name__}: {error}")
    return done, failures


def _build(jobs: int, shown: bool) -> list[str]:
    from rich.progress import track

    failures: list[str] = []
    began, todo, done = time.monotonic(), tasks(), 0
    results = _in_processes(todo, jobs)
    if shown and err.is_terminal:
        results = track(results, "compiling", total=len(todo), console=err)
    for number, failed in results:
        done += number
        failures += failed
    if shown:
        err.print(f"{done} methods on problems, compiled in {time.monotonic() - began:.0f} s", highlight=False)
    return failures


def _in_processes(todo: list, jobs: int) -> Iterator[tuple[int, list[str]]]:
    import os
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from multiprocessing import get_context

    with ProcessPoolExecutor(jobs or os.cpu_count(), mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(made, task) for task in todo]):
            yield future.result()
