"""Integrate orbits of an ensemble one by one with a compiled kernel, on threads, if they cannot run in SIMD lanes.

A kernel (loop over steps) runs without the interpreter's lock, but the Python code of `integrate` before and after it
does not: threads that call `integrate` for each orbit wait for one another.  Here that code runs once for all orbits.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial

import numpy as np

from .batches import Orbits
from .prepared import Layout, lay_out, step_of
from .stepping.codes import SOLVED
from .stepping.kernel import prepare
from .threads import map_slices


def run(orbits: Orbits, members: np.ndarray, threads: int, tell: Callable[[int], None]) -> np.ndarray:
    """Integrate the orbits with the indices ``members`` and fill their rows; return the indices left for `integrate`.

    Left are the orbits whose kernel stopped early, and all orbits of methods that may take fallbacks: steps without the
    property that the method promises.  ``tell`` is called with the number of orbits finished since its last call.
    """
    known = {k: prepare(orbits.kinds[k], orbits.system) for k in set(orbits.kind[members].tolist())}
    whole = np.array([not known[k].missed for k in orbits.kind[members].tolist()], bool)
    mine, left = members[whole], [members[~whole]]
    found = map_slices(lambda part: _share(orbits, known, mine[part]), len(mine), threads, orbits.halt)
    for counts, stopped, n in found:
        for name, number in counts.items():
            orbits.counts[name] += number
        left.append(stopped)
        tell(n - len(stopped))
    return np.concatenate(left).astype(int)


def _share(orbits: Orbits, known: dict, members: np.ndarray) -> tuple[Counter[str], np.ndarray, int]:
    """Integrate the orbits ``members``: (counts of those at the end, indices of those that stopped, number of all)."""
    total: Counter[str] = Counter()
    layouts: dict[int, Layout] = {}
    stopped = []
    for i in members.tolist():
        kernel, q, p = known[orbits.kind[i]], orbits.q[i], orbits.p[i]
        layout = layouts.get(orbits.kind[i])
        if layout is None:
            layout = layouts[orbits.kind[i]] = lay_out(kernel, orbits.system.d, orbits.h[i], q, p)
            orbits.measure(i, partial(_try_steps, layout, orbits.system.d))
        layout.step = step_of(kernel, orbits.system.d, orbits.h[i], q, p)
        layout.restart(q, p)
        if not _fill(orbits, i, layout):
            stopped.append(i)
            continue
        numbers = (int(layout.counts[name]) for name in ("gradient", "fallbacks", "newton"))
        total.update(kernel.tally(int(orbits.steps[i]), *numbers))
    return total, np.array(stopped, int), len(members)


def _try_steps(layout: Layout, d: int, steps: int) -> None:
    """Go on for some steps whose end is not used."""
    layout(np.zeros((1, d)), np.zeros((1, d)), np.zeros((1, 1)), steps)


def _fill(orbits: Orbits, i: int, layout: Layout) -> bool:
    """Integrate orbit i and fill its rows; True if the end was reached."""
    member = np.array([i])
    keep, taken = orbits.keeper(member, 1), 0
    for first, rows, every in orbits.calls(member):
        Q, P = orbits.room(i, first, rows)
        if layout(Q, P, np.full((rows, 1), np.nan), every) != (rows, SOLVED):
            return False
        taken += rows * every
        keep(first, Q[None, :, :, None], P[None, :, :, None], taken)
    orbits.end(member)
    return True
