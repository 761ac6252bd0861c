"""The equations of motion as passed to heyoka: translated from H, or one of its own models.

heyoka's models are Newton's equations in x and v.  `NBODY` (``hy.model.nbody``) is gravity between bodies, `CENTRE`
(``hy.model.fixed_centres``) a body about a fixed one; both are three-dimensional, and a plane orbit has z = 0.
``hy.model.pendulum`` equals the two equations translated from the pendulum's H; ``hy.model.cr3bp`` is not needed here.
In H(q, p, t) the time is ``hy.time``, no component of the state: the local error is relative to the state's norm, which
a time of 1000 would make large (measured: errors 50 to 1000 times as large at one tolerance).
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
    time : the component of (q, p) that is the time, which the state vector lacks; its initial value is heyoka's
        parameter 0; None if no component is
    """

    equations: tuple
    at: np.ndarray | None = None
    scale: np.ndarray | None = None
    time: int | None = None

    def put(self, y: np.ndarray) -> np.ndarray:
        """The state of heyoka's integrator for y = (q, p), an array (2 d,)."""
        if self.time is not None:
            return np.delete(y, self.time)
        if self.at is None:
            return y
        out = np.zeros(len(self.equations))
        out[self.at] = self.scale * y
        return out

    def parameters(self, y: np.ndarray) -> np.ndarray:
        """The parameters of heyoka's integrator for the initial y = (q, p), an array (2 d,)."""
        return y[[] if self.time is None else [self.time]]

    def get(self, states: np.ndarray, parameters: np.ndarray, times: np.ndarray | float) -> np.ndarray:
        """(q, p) from a state or from rows of states at ``times``, as new arrays (..., 2 d)."""
        if self.time is not None:
            return np.insert(states, self.time, parameters[0] + times, axis=-1)
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
        translated = taylor.equations(system, float, program(system))
        if not system.driven:
            return Form(tuple(translated))
        time, _ = translated.pop(system.d - 1)
        right = hy.subs([side for _, side in translated], {time: hy.time + hy.par[0]})
        return Form(tuple(zip((x for x, _ in translated), right, strict=True)), time=system.d - 1)
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
