"""The equations of motion as passed to heyoka: translated from H, or one of its own models.

heyoka's models are Newton's equations in x and v.  `NBODY` (``hy.model.nbody``) is gravity between bodies, `CENTRE`
(``hy.model.fixed_centres``) a body about a fixed one; both are three-dimensional, and a plane orbit has z = 0.
``hy.model.pendulum`` equals the two equations translated from the pendulum's H; ``hy.model.cr3bp`` is not needed here.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from . import forms

if TYPE_CHECKING:
    from phasebench.integrators.compile.printing import Program
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

TRANSLATED, NBODY, CENTRE = "translated", "nbody", "fixed_centres"
NAMES = (TRANSLATED, NBODY, CENTRE)
#: Size of the cache of forms.
KEPT = 64
#: The most degrees of freedom of a system whose H is tried multiplied out, too.
FEW = 3


class Form(NamedTuple):
    """Equations of motion for heyoka, and the places of (q, p) in the state vector that they integrate.

    Attributes
    ----------
    equations : heyoka's [(variable, right-hand side), ...]
    at, scale : arrays (2 d,): component at[i] of the state vector is scale[i] times component i of (q, p), other
        components are 0; None if the state vector is (q, p)
    """

    equations: tuple
    at: np.ndarray | None = None
    scale: np.ndarray | None = None

    def put(self, y: np.ndarray) -> np.ndarray:
        """The state of heyoka's integrator for y = (q, p), an array (2 d,)."""
        if self.at is None:
            return y
        out = np.zeros(len(self.equations))
        out[self.at] = self.scale * y
        return out

    def get(self, states: np.ndarray) -> np.ndarray:
        """(q, p) from a state or from rows of states, as new arrays (..., 2 d)."""
        return np.array(states) if self.at is None else states[..., self.at] / self.scale


def names(system: PartitionedSystem) -> tuple[str, ...]:
    """The ways in which heyoka can be given a system's equations: translated from H, or a model of heyoka's own."""
    settings = forms.settings(system)
    centre = settings.get(forms.CENTRAL)
    alone = centre is not None and centre.gradient is None
    return (TRANSLATED, *([NBODY] if forms.GRAVITY in settings else []), *([CENTRE] if alone else []))


def operations(program: Program) -> int:
    """The number of operations in the right-hand sides of a system."""
    import sympy as sp

    definitions, vectors = program
    return sum(sp.count_ops(e) for e in (*(e for _, e in definitions), *(e for v in vectors for e in v)))


@lru_cache(maxsize=KEPT)
def program(system: PartitionedSystem) -> Program:
    """The right-hand sides of a system, of H as it is given or multiplied out, whichever take fewer operations."""
    from sympy import expand

    from phasebench.integrators.systems import shared

    given = system.shared
    if system.d > FEW or not system.canonical or system.loops:
        return given
    return min(given, shared.motion(system, lambda H, x: shared.gradient(expand(H), x)), key=operations)


@lru_cache(maxsize=KEPT)
def form(system: PartitionedSystem, name: str) -> Form:
    """The equations of motion of a system in the form ``name``, one of `names(system)`."""
    import heyoka as hy

    from phasebench.reference.solvers import taylor

    if name == TRANSLATED:
        return Form(tuple(taylor.equations(system, float, program(system))))
    setting = forms.settings(system)[forms.GRAVITY if name == NBODY else forms.CENTRAL]
    if name == NBODY:
        model = hy.model.nbody(len(setting.masses), masses=setting.masses, Gconst=setting.G)
    else:
        model = hy.model.fixed_centres(Gconst=1.0, masses=setting.masses[:1], positions=[[0.0, 0.0, 0.0]])
    return Form(tuple(model), *_places(setting))


def _places(setting: forms.Setting) -> tuple[np.ndarray, np.ndarray]:
    """Return where (q, p) is in the state vector of one of heyoka's models: `Form.at` and `Form.scale`.

    The state vector has x, y, z, vx, vy, vz of each moving body; velocities are momenta divided by masses.
    """
    body, axis = map(np.array, setting.places)
    x = 6 * (body - setting.first) + axis
    return np.concatenate([x, x + 3]), np.concatenate([np.ones(len(x)), setting.inverse])
