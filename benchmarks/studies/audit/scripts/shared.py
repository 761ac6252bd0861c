"""What the scripts share; it needs NumPy alone."""

from pathlib import Path

import numpy as np

#: Begins each line that a script prints, since packages print, too.
MARK = "audit: "


def file_of(script):
    """The file with the function of this name."""
    files = Path(__file__).parent.glob("of_*.py")
    return next(p for p in files if script.startswith(f"{p.stem.removeprefix('of_')}_"))


def pendulum(t, y):
    """The field of a pendulum, y = (q, p)."""
    return np.array([y[1], -np.sin(y[0])])


def order(end, n, exact=None):
    """The order by the errors of n and 2 n steps; by the differences of n, 2 n and 4 n steps without an exact end."""
    coarse, fine = end(n), end(2 * n)
    errors = (coarse - fine, fine - end(4 * n)) if exact is None else (coarse - exact, fine - exact)
    return f"{np.log2(np.abs(errors[0]).max() / np.abs(errors[1]).max()):.2f}"


def defect(flow, y=(1.0, 0.5), d=1e-5):
    """max |M^T J M - J|, M the Jacobian of ``flow`` at y by central differences."""
    J = np.array([[0, 1], [-1, 0]])
    M = np.array([(flow(y + d * e) - flow(y - d * e)) / (2 * d) for e in np.eye(2)]).T
    return f"{np.abs(M.T @ J @ M - J).max():.1e}"
