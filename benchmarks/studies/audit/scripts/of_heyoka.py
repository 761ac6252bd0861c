"""Scripts on heyoka."""

import heyoka as hy
import numpy as np


def heyoka_tolerance():
    """The energy error over 1e4 periods of a pendulum at the default tolerance, "machine precision"."""
    q, p = hy.make_vars("q", "p")
    for compensated in (False, True):
        ta = hy.taylor_adaptive([(q, p), (p, -hy.sin(q))], [1.0, 0.5], high_accuracy=compensated)
        states = ta.propagate_grid(np.linspace(0, 7e4, 1001))[5]
        H = states[:, 1] ** 2 / 2 - np.cos(states[:, 0])
        yield f"largest energy error, high_accuracy {compensated}", f"{np.abs(H - H[0]).max():.1e}"
