r"""Values of steps and their extrapolation by backward differences.

With :math:`\nabla^0 x_n = x_n` and :math:`\nabla^{k+1} x_n = \nabla^k x_n - \nabla^k x_{n-1}` the polynomial through
the last m values goes on to :math:`x_{n+1} = \sum_{k<m}\nabla^k x_n`.  The differences stand in fixed places, so that
nothing is computed of where they are, and the next value is ready before the step that needs it begins.
"""

from __future__ import annotations

import numpy as np

from .vector import axpy, inlined, load, minus, store


def table(levels):
    """The function (memory, first, known, x) -> the value to follow x, from at most so many values.

    ``known`` values came before x; their differences are the rows first, ..., first + levels - 1 of ``memory``.
    """
    rows = tuple(np.uintp(k) for k in range(levels))

    @inlined
    def enter(memory, first, known, x):
        following, difference = x, x
        for k in range(levels):
            old = load(memory, first + rows[k], x)
            store(memory, first + rows[k], difference)
            difference = minus(difference, old)
            if k + 1 < levels:
                following = axpy(1.0 if k < known else 0.0, difference, following)
        return following

    return enter


def columns(levels, fewer):
    """As `table`, of numbers in the columns column, column + 1, ... of a row: what follows by so many, and by fewer."""

    @inlined
    def enter(numbers, row, column, known, x):
        following, short, difference = x, x, x
        for k in range(levels):
            old = numbers[row, column + k]
            numbers[row, column + k] = difference
            difference = difference - old
            if k + 1 < levels and k < known:
                following = following + difference
            if k + 1 < fewer and k < known:
                short = short + difference
        return following, short

    return enter
