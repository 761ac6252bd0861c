"""Forms in which heyoka is given the equations of motion: translated from H, or a model of its own.

heyoka's models are of Newton's equations in x and v.  `NBODY` (``hy.model.nbody``) is gravity between bodies, `CENTRE`
(``hy.model.fixed_centres``) a body about one at rest; both are three-dimensional, and a plane orbit stays in z = 0.
``hy.model.pendulum`` is the two equations into which the pendulum's H is translated; ``hy.model.cr3bp`` is of no
problem here.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from . import particles

TRANSLATED, NBODY, CENTRE = "translated", "nbody", "fixed_centres"
NAMES = (TRANSLATED, NBODY, CENTRE)
#: Systems of which the forms are kept.
KEPT = 64


class Form(NamedTuple):
    """Equations of motion, and where (q, p) is in their state.

    Attributes
    ----------
    equations : [(variable, right-hand side), ...] of heyoka
    at, scale : arrays (2 d,): component at[i] of the state is scale[i] times (q, p)[i], the others are 0; None where
        the state is (q, p)
    """

    equations: tuple
    at: np.ndarray | None = None
    scale: np.ndarray | None = None

    def put(self, y) -> np.ndarray:
        """The state of (q, p), an array (2 d,)."""
        if self.at is None:
            return y
        out = np.zeros(len(self.equations))
        out[self.at] = self.scale * y
        return out

    def get(self, states) -> np.ndarray:
        """(q, p) of a state or of rows of them, new arrays (..., 2 d)."""
        return np.array(states) if self.at is None else states[..., self.at] / self.scale


def names(system) -> tuple[str, ...]:
    """The forms that a system has."""
    settings = particles.settings(system)
    centre = settings.get(particles.CENTRAL)
    alone = centre is not None and centre.gradient is None
    return (TRANSLATED, *([NBODY] if particles.GRAVITY in settings else []), *([CENTRE] if alone else []))


@lru_cache(maxsize=KEPT)
def form(system, name: str) -> Form:
    """A form of a system, one of its `names`."""
    import heyoka as hy

    from phasebench.reference.solvers import taylor

    if name == TRANSLATED:
        return Form(tuple(taylor.equations(system, float)))
    setting = particles.settings(system)[particles.GRAVITY if name == NBODY else particles.CENTRAL]
    if name == NBODY:
        model = hy.model.nbody(len(setting.masses), masses=setting.masses, Gconst=setting.G)
    else:
        model = hy.model.fixed_centres(Gconst=1.0, masses=setting.masses[:1], positions=[[0.0, 0.0, 0.0]])
    return Form(tuple(model), *_places(setting))


def _places(setting: particles.Setting) -> tuple[np.ndarray, np.ndarray]:
    """Where q and p are among x, y, z, v_x, v_y, v_z of every body that moves, and what they are multiplied by."""
    inverse = np.array(setting.inverse)
    x = np.array([6 * (body - setting.first) + axis for body, axis in map(setting.place, range(len(inverse)))])
    return np.concatenate([x, x + 3]), np.concatenate([np.ones(len(inverse)), inverse])
