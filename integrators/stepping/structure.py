"""Find the sparsity of a Jacobian by probing its function, and reorder its unknowns for a narrow band.

If a component of the argument is NaN, all results that depend on it are NaN.  Blocks of components are set to NaN, then
their halves; blocks that act on different equations are probed at once, so that a lattice takes about as many
evaluations as log2 of its length, times a few.  A dependence that does not show in this way (a comparison) shows in
finite differences along random directions, which the sparse matrix must reproduce.

The order of unknowns is that of Cuthill and McKee, reversed: from a site outwards, so that a ring is folded and its
ends need no correction.  Columns that share no equation have a colour in common, and one difference.

Sources: E. Cuthill, J. McKee, Proc. 24th National Conference ACM (1969) 157-172; A. Curtis, M. Powell, J. Reid,
J. Inst. Math. Appl. 13 (1974) 117-119 (colours).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from phasebench.integrators.errors import InvalidInput

#: Equations that need more colours than this, or a wider band, are not those of a lattice.
MOST = 64
#: Largest relative disagreement of a directional difference with the sum over the columns; relative length of these
#: differences; seed of the random directions.
APART, STEP, SEED = 1e-3, 1e-5, 5


def find_structure(f: Callable, points: Sequence[np.ndarray]) -> list[np.ndarray]:
    """For each component of x, find the indices of the components of f(x) that depend on it; f maps n numbers to n.

    Probes f, and checks the result, at the first of the ``points``, arrays (n,), where f is finite.

    Raises
    ------
    InvalidInput
        If f is finite at none of them, if more than `MOST` groups of components have to be told apart, or if f hides
        from the probes a dependence that its differences show.
    """
    with np.errstate(all="ignore"):
        at = next((x for x in points if _finite(f, x)), None)
        if at is None:
            raise InvalidInput("the structure cannot be probed: the functions are finite at none of the points tried")
        reach = _probe(f, at)
        _check(f, at, reach)
    return reach


def _finite(f: Callable, x: np.ndarray) -> bool:
    try:
        return bool(np.isfinite(f(x)).all())
    except (ArithmeticError, ValueError):  # functions that are not compiled raise where compiled ones give NaN
        return False


def _probe(f: Callable, at: np.ndarray) -> list[np.ndarray]:
    n = len(at)
    blocks, reach = [(0, n)], [np.arange(n)]
    while len(blocks) < n:
        halves = [_halves(*block) for block in blocks]
        reach = [r for r, parts in zip(reach, halves, strict=True) for _ in parts]
        blocks = [part for parts in halves for part in parts]
        groups = colour_columns(reach, n)
        touched = []
        for group in range(1 + max(groups)):
            x = at.copy()
            for (low, high), own in zip(blocks, groups, strict=True):
                if own == group:
                    x[low:high] = np.nan
            touched.append(np.isnan(f(x)))
        reach = [r[touched[group][r]] for r, group in zip(reach, groups, strict=True)]
    return reach


def _halves(low: int, high: int) -> list[tuple[int, int]]:
    middle = (low + high) // 2
    return [(low, middle), (middle, high)] if middle > low else [(low, high)]


def colour_columns(reach: Sequence[np.ndarray], n: int) -> list[int]:
    """Colour the columns of a sparse matrix so that no two of one colour have nonzeros in the same row.

    ``reach[j]`` are the rows of the nonzeros of column j, ``n`` is the number of rows.  Returns each column's colour,
    an integer from 0.  Raises InvalidInput if that takes more than `MOST` colours.
    """
    taken, colours = [0] * n, []
    for rows in reach:
        rows, used = rows.tolist(), 0
        for i in rows:
            used |= taken[i]
        free = ~used & (used + 1)
        if free >> MOST:
            raise InvalidInput(_dense(f"more than {MOST} variables act on one equation"))
        colours.append(free.bit_length() - 1)
        for i in rows:
            taken[i] |= free
    return colours


def _dense(why: str) -> str:
    return f"the equations are not banded: {why}; leave the solver out, or take another method"


def owners(reach: Sequence[np.ndarray], colours: Sequence[int]) -> np.ndarray:
    """For each colour and row, find the column of this colour that has a nonzero there, or -1: array (colours, rows).

    ``reach[j]`` are the rows of the nonzeros of column j, ``colours[j]`` is its colour (`colour_columns`).
    """
    out = np.full((1 + max(colours), len(reach)), -1)
    for j, (rows, colour) in enumerate(zip(reach, colours, strict=True)):
        out[colour, rows] = j
    return out


def _check(f: Callable, at: np.ndarray, reach: Sequence[np.ndarray]) -> None:
    """Raise InvalidInput unless a Jacobian with these nonzeros reproduces differences of f along random directions.

    ``at`` is the point, ``reach[j]`` are the rows of the nonzeros of column j.
    """
    colours = np.array(colour_columns(reach, len(at)))
    owner = owners(reach, colours)
    step = STEP * (1 + np.abs(at).max())

    def slope(v: np.ndarray) -> np.ndarray:
        return (f(at + step * v) - f(at - step * v)) / (2 * step)

    slopes = np.array([slope(1.0 * (colours == c)) for c in range(len(owner))])
    for v in np.random.default_rng(SEED).uniform(0.5, 1.0, size=(2, len(at))) * [[1.0], [-1.0]]:
        along = slope(v)
        terms = np.where(owner >= 0, slopes, 0.0) * v[owner]
        wrong = ~(np.abs(terms.sum(0) - along) <= APART * (np.abs(terms).sum(0) + np.abs(along) + np.abs(along).mean()))
        if wrong.any():
            hidden = "depends on more variables than those that show when they are not numbers"
            raise InvalidInput(f"the structure is not what probing found: component {wrong.argmax()} {hidden}")


def band_order(reach: Sequence[np.ndarray]) -> tuple[np.ndarray, int]:
    """Order the unknowns of a sparse matrix so that its band is narrow (reverse Cuthill-McKee).

    ``reach[j]`` are the rows of the nonzeros of column j.  Returns (position of each unknown in the order, half-width
    of the band).  Raises InvalidInput if the half-width is more than `MOST`.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    n = len(reach)
    rows = np.concatenate(reach)
    columns = np.repeat(np.arange(n), [len(r) for r in reach])
    graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    place = np.empty(n, np.int64)
    place[reverse_cuthill_mckee((graph + graph.T).tocsr(), symmetric_mode=True)] = np.arange(n)
    width = int(np.abs(place[rows] - place[columns]).max(initial=0))
    if width > MOST:
        raise InvalidInput(_dense(f"in the best order found an equation reaches {width} unknowns far"))
    return place, width
