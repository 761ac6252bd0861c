"""Write a trajectory as CSV, a column for each component, or as NumPy's npz; the whole file or none."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    import numpy as np

    from phasebench.integrators.solution import Solution

SUFFIXES = (".csv", ".npz")


def write(path: Path, solution: Solution, every: int = 1) -> int:
    """Write rows 0, ``every``, 2 ``every``, ... of a solution and the last to the file ``path``; return their number.

    Raises InvalidInput if the file cannot be written.
    """
    import numpy as np

    from phasebench.reference.files import write_file

    last = len(solution.t) - 1
    kept = sorted({*range(0, last + 1, every), last})
    t, q, p = (np.asarray(x)[kept] for x in (solution.t, solution.q, solution.p))
    try:
        if path.suffix.lower() == ".npz":
            whole = io.BytesIO()
            np.savez(whole, t=t, q=q, p=p)
            write_file(path, whole.getvalue())
        else:
            write_file(path, _csv(t, q, p))
    except OSError as error:
        raise InvalidInput(f"--output {path} cannot be written: {error.strerror or error}") from None
    return len(kept)


def _csv(t: np.ndarray, q: np.ndarray, p: np.ndarray) -> str:
    """The trajectory as CSV text; each number has the fewest digits that give the double back."""
    d = q.shape[1]
    names = ["t", *(f"{x}{i}" for x in "qp" for i in range(1, d + 1))]
    rows = (",".join(repr(float(x)) for x in (time, *a, *b)) for time, a, b in zip(t, q, p, strict=True))
    return "\n".join([",".join(names), *rows]) + "\n"
