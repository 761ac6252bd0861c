"""Converts arrays to the text of one table cell, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def pack(values: ArrayLike, digits: int = 6) -> str:
    """The numbers of an array as text, separated by spaces, with ``digits`` significant digits."""
    return " ".join(f"{x:.{digits}g}" for x in np.ravel(values))


def unpack(cell: str | float) -> np.ndarray:
    """The array (n,) from the text of `pack`; an empty array for an empty cell."""
    return np.array(cell.split(), dtype=float) if isinstance(cell, str) else np.empty(0)
