"""heyoka's Taylor series as peers: one orbit, or the same orbit in every SIMD lane of the processor.

``high_accuracy`` sums the series with compensation.  ``compact_mode`` compiles faster and runs two to three times
slower; the peers use it for equations of more than `UNROLLED` operations.  `variants` lists each peer in the other
mode, and with heyoka's own models of the equations of motion (`heyoka_forms`), for comparison.

Integrators are cached by system and tolerance, so that a second run needs no compilation.  They are reset in place,
hence only one thread at a time may run a peer on a system.

Source: F. Biscani, D. Izzo, Mon. Not. R. Astron. Soc. 504 (2021) 2614-2628.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.integrators.record import ROUND_OFF

from . import heyoka_forms
from .heyoka_forms import TRANSLATED
from .record import SOLVED, STALLED, Calls, Claims, Peer, Run, Task

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

EPS = float(np.finfo(float).eps)
#: Size of the cache of integrators.
KEPT = 128
#: Equations of more operations are compiled in compact mode: unrolled ones take over ten seconds at a tight tolerance.
UNROLLED = 600
DOCUMENTATION = "https://bluescarni.github.io/heyoka.py/"


@lru_cache(maxsize=KEPT)
def is_compact(system: PartitionedSystem) -> bool:
    """True if the peers compile the equations of a system in compact mode."""
    return heyoka_forms.operations(heyoka_forms.program(system)) > UNROLLED


@lru_cache(maxsize=KEPT)
def _scalar(
    system: PartitionedSystem,
    tol: float,
    model: str = TRANSLATED,
    compact: bool | None = None,
    high_accuracy: bool = False,
) -> tuple[Any, heyoka_forms.Form]:
    """Make heyoka's integrator for one orbit of a system: (integrator, the `Form` of its state).

    ``model`` is one of `heyoka_forms.NAMES`, the form of the equations; ``compact`` turns heyoka's ``compact_mode`` on
    or off, None by `is_compact`; ``high_accuracy`` sums the series with compensation.
    """
    import heyoka as hy

    form = heyoka_forms.form(system, model)
    compact = is_compact(system) if compact is None else compact
    options = {"compact_mode": compact, "high_accuracy": high_accuracy}
    return hy.taylor_adaptive(list(form.equations), np.zeros(len(form.equations)), tol=tol, **options), form


@lru_cache(maxsize=KEPT)
def _batch(system: PartitionedSystem, tol: float) -> Any:
    import heyoka as hy

    one, form = _scalar(system, tol)
    zeros = np.zeros((one.dim, hy.recommended_simd_size()))
    return hy.taylor_adaptive_batch(list(form.equations), zeros, tol=one.tol, compact_mode=one.compact_mode)


def _build_run(*how: str | bool | None) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        from phasebench.reference.solvers import taylor

        ta, form = _scalar(task.system, task.tol, *how)
        ta.time, ta.state[:], ta.pars[:] = 0.0, form.put(task.state), form.parameters(task.state)
        if len(task.times) > 2:
            started = time.perf_counter()
            rows, steps, failure = taylor.propagate(ta, task.times)
            seconds = time.perf_counter() - started
            return Run.of_states(form.get(rows, ta.pars, task.times[: len(rows)]), steps, 0, seconds, failure)
        start, t_end = task.state, float(task.times[-1])
        started = time.perf_counter()
        outcome, _, _, steps, *_ = ta.propagate_until(t_end, max_steps=taylor.STEP_LIMIT)
        seconds = time.perf_counter() - started
        failure = taylor.failure(outcome)
        rows = np.stack([start, form.get(ta.state, ta.pars, t_end)] if failure is None else [start])
        return Run.of_states(rows, steps, 0, seconds, failure)

    return run


def _prepare(*how: str | bool | None) -> Callable[[Task], Calls]:
    def prepare(task: Task) -> Calls:
        kept, form = _scalar(task.system, task.tol, *how)
        ta = kept.__copy__()  # a copy, whose state belongs to this run alone
        state, begin, propagate = ta.state, ta.state.copy(), ta.propagate_until

        def restart(y: np.ndarray) -> None:
            begin[:], ta.pars[:] = form.put(y), form.parameters(y)

        def advance(t_end: float) -> int:
            ta.time = 0.0
            state[:] = begin
            propagate(t_end)
            return SOLVED if ta.time == t_end else STALLED

        return Calls(restart, advance, lambda: form.get(state, ta.pars, ta.time), ta)

    return prepare


def _run_batch(task: Task) -> Run:
    from phasebench.reference.solvers import taylor

    ta, form = _batch(task.system, task.tol), heyoka_forms.form(task.system, TRANSLATED)
    ta.set_time(0.0)
    ta.state[:], ta.pars[:] = form.put(task.state)[:, None], form.parameters(task.state)[:, None]
    grid = np.repeat(task.times[:, None], ta.batch_size, axis=1)
    started = time.perf_counter()
    _, states = ta.propagate_grid(grid, max_steps=taylor.STEP_LIMIT)
    seconds = time.perf_counter() - started  # of all lanes, which is also the time of one orbit
    rows = form.get(states[:, :, 0], ta.pars[:, 0], task.times[: len(states)])
    outcome, _, _, steps = ta.propagate_res[0]
    failure = taylor.failure(outcome)
    if failure is None and not (states == states[:, :, :1]).all():
        rows, failure = rows[:1], f"the {ta.batch_size} lanes, which started alike, differ"
    return Run.of_states(rows, steps, 0, seconds, failure)


def _untranslated(problem: Any, system: PartitionedSystem) -> str | None:
    import sympy as sp

    from phasebench.reference.solvers.translate import FUNCTIONS

    names = sorted({type(f).__name__ for f in system.H.atoms(sp.Function)}) if isinstance(system.H, sp.Basic) else []
    return next((f"heyoka has no function {name}" for name in names if name not in FUNCTIONS), None)


def _peer(id: str, name: str, run: Callable[[Task], Run], more: str, **facts: Any) -> Peer:
    return Peer(
        id,
        name,
        package="heyoka",
        adaptive=True,
        license="MPL-2.0",
        about="tol is the local error relative to the state and chooses the order of the series; the default is the "
        f"machine epsilon; compiled by LLVM; {more}",
        source="Biscani & Izzo 2021, Mon. Not. R. Astron. Soc. 504, 2614-2628",
        run=run,
        claims=Claims(
            energy=ROUND_OFF,
            source=f"{DOCUMENTATION}: machine precision is kept over tens of billions of steps (at the default tol); "
            "the attributes tol and order of an integrator: the order follows from the tolerance",
        ),
        tol=EPS,
        least=EPS / 2,
        **{"lacks": _untranslated} | facts,
    )


def _one(id: str, name: str, more: str, how: tuple, **facts: Any) -> Peer:
    """Make the record of a peer that integrates one orbit by heyoka.

    ``how`` is (form of the equations, compact mode or None to decide by size, True to sum the series with
    compensation).  ``more`` ends the record's text ``about``; ``facts`` are further fields of the record.
    """
    return _peer(id, name, _build_run(*how), more, prepare=_prepare(*how), **facts)


def compact(high_accuracy: bool, on: bool = True, model: str = TRANSLATED) -> Peer:
    """Make a peer outside the registry: heyoka with ``compact_mode`` on or off, and a form of the equations.

    ``model`` is one of `heyoka_forms.NAMES`; ``high_accuracy`` sums the series with compensation.
    """

    def lacks(problem: Any, system: PartitionedSystem) -> str | None:
        if model == TRANSLATED and on == is_compact(system):
            return f"'{name}' is the same on this system: compact_mode is {'on' if on else 'off'}"
        if model not in heyoka_forms.names(system):
            return f"heyoka's model {model} is of other equations of motion"
        return None

    name = "heyoka-high-accuracy" if high_accuracy else "heyoka"
    options = [] if model == TRANSLATED else [f"model={model}"]
    options += ["compact_mode"] if on else ["compact_mode=False"]
    mode = f"{'' if on else 'no '}compact mode{'' if model == TRANSLATED else f', its own model {model}'}"
    how = (model, on, high_accuracy)
    return _one(f"{name}({', '.join(options)})", f"{SERIES}, {mode}", f"one orbit; {mode}", how, lacks=lacks)


def variants() -> tuple[Peer, ...]:
    """Peers outside the registry, for comparison: heyoka in both compact modes, with each form of the equations."""
    settings = [(high, on, model) for model in heyoka_forms.NAMES for on in (True, False) for high in (False, True)]
    return tuple(compact(*setting) for setting in settings)


def twins(peer: Peer) -> tuple[Peer, ...]:
    """The other peers of heyoka that take the same steps as ``peer``: compact mode on or off, each form of equations.

    () for a peer of another package.
    """
    if peer.package != "heyoka":
        return ()
    high = peer.id.startswith("heyoka-high-accuracy")
    alike = [p for p in (*PEERS, *variants()) if p.id.startswith("heyoka-high-accuracy") == high]
    return tuple(p for p in alike if p.id not in (peer.id, "heyoka-batch"))


SERIES = "Taylor series of adaptive step and order, double precision"
PEERS = (
    _one("heyoka", SERIES, "one orbit", (TRANSLATED, None, False)),
    _one(
        "heyoka-high-accuracy",
        f"{SERIES}, compensated",
        "one orbit; high_accuracy: the series is summed with compensation",
        (TRANSLATED, None, True),
    ),
    _peer(
        "heyoka-batch",
        f"{SERIES}, SIMD lanes",
        _run_batch,
        "the same orbit in each of recommended_simd_size() lanes at once: seconds are of all lanes together, in which "
        "that many orbits could be had",
    ),
)
