r"""diffrax's solvers of ordinary differential equations as peers, compiled by JAX, at constant steps.

The loop is diffrax's manual stepping, ``solver.step(terms, t0, t1, y, args, state, made_jump)``, inside one compiled
JAX loop.  `diffrax.diffeqsolve` with ConstantStepSize takes the same steps up to round-off: there the time is a sum of
steps, a step is the difference of two times, and rows in between are interpolated.  Here every step goes from 0 to h,
except for LeapfrogMidpoint, which stores the time before last and gets n h.

Two solvers carry more than the state between steps: LeapfrogMidpoint the previous state (its first step is Euler's),
ReversibleHeun a second copy with its slope (for the pair diffrax says "algebraically reversible").  Both are measured
from a start that is given by the state alone.

- SemiImplicitEuler takes :math:`q' = T_p(p), p' = -V_q(q)` as two terms;
- Sil3 and KenCarp3-5 take an explicit and an implicit term, here the equations of q and those of p;
- the equations of implicit solvers are solved by Optimistix's Newton method to the tolerance `ROOT`; diffrax's default,
  a chord method, takes its tolerances from an adaptive step-size control, which is not used here.

Left out are the solvers of stochastic equations, and HalfSolver, which adds an error estimate to another solver.
Double precision is switched on only during the calls made here (`jax_loop`).

Source: P. Kidger, On Neural Differential Equations, PhD thesis, University of Oxford (2021).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.reference.files import entries

from .jax_loop import COST, Loop, jax_function, run_loop
from .record import Claims, Peer, split_alone

if TYPE_CHECKING:
    import jax

    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: rtol and atol for implicit equations, and the largest number of iterations.
ROOT, ITERATIONS = 1e-12, 30
#: Size of the cache of compiled loops.
KEPT = 256
SOLVERS = "https://docs.kidger.site/diffrax/api/solvers/ode_solvers"

WHOLE, HALVES, IMEX = "the field", "the equations of q and of p in turn", "explicit in q, implicit in p"
IMPLICIT = ("ImplicitEuler", "Kvaerno3", "Kvaerno4", "Kvaerno5", "Sil3", "KenCarp3", "KenCarp4", "KenCarp5")


def solver(name: str) -> Any:
    """The diffrax solver of this name, with Newton's method if it is implicit."""
    import diffrax
    import optimistix

    if name not in IMPLICIT:
        return getattr(diffrax, name)()
    newton = optimistix.Newton(rtol=ROOT, atol=ROOT)
    return getattr(diffrax, name)(root_finder=newton, root_find_max_steps=ITERATIONS)


def _terms(system: PartitionedSystem, split: str) -> Any:
    """Write the system's equations as diffrax's terms, for a state of shape (2 d,).

    ``split`` is `WHOLE` (a single term), `HALVES` (the equations of q and of p as two terms, for a state that is a pair
    of arrays (d,)) or `IMEX` (an explicit term with the equations of q, an implicit one with those of p).
    """
    import diffrax
    import jax.numpy as jnp

    d = system.d
    if split == HALVES:
        velocity, force = jax_function([system.p], system.dq), jax_function([system.q], system.dp)
        return (
            diffrax.ODETerm(lambda t, p, args: velocity(p)),
            diffrax.ODETerm(lambda t, q, args: force(q)),
        )
    both = [system.q, system.p]
    dq, dp = jax_function(both, system.dq), jax_function(both, system.dp)
    if split == WHOLE:
        field = jax_function(both, [*system.dq, *system.dp])
        return diffrax.ODETerm(lambda t, y, args: field(y[:d], y[d:]))
    still = np.zeros(d)
    return diffrax.MultiTerm(
        diffrax.ODETerm(lambda t, y, args: jnp.concatenate([dq(y[:d], y[d:]), still])),
        diffrax.ODETerm(lambda t, y, args: jnp.concatenate([still, dp(y[:d], y[d:])])),
    )


@lru_cache(maxsize=KEPT)
def _compile(name: str, split: str, system: PartitionedSystem) -> Loop:
    """The compiled loop over the steps of diffrax's solver ``name`` on a system; ``split`` as for `_terms`."""
    import diffrax
    import jax.numpy as jnp

    method, terms, multistep, d = solver(name), _terms(system, split), name == "LeapfrogMidpoint", system.d

    def begin(y: jax.Array, h: jax.Array) -> tuple[Any, Any]:
        y = (y[:d], y[d:]) if split == HALVES else y
        return y, method.init(terms, jnp.zeros_like(h), h, y, None)

    def step(k: jax.Array, h: jax.Array, carried: tuple[Any, Any]) -> tuple[tuple[Any, Any], Any]:
        y, inner = carried
        t0, t1 = (k * h, (k + 1) * h) if multistep else (jnp.zeros_like(h), h)
        y, _, _, inner, result = method.step(terms, t0, t1, y, None, inner, False)
        return (y, inner), result != diffrax.RESULTS.successful

    def state(carried: tuple[Any, Any]) -> jax.Array:
        return jnp.concatenate(carried[0]) if split == HALVES else carried[0]

    return Loop(d, begin, step, state)


def _peer(
    id: str,
    name: str,
    title: str,
    order: int,
    source: str,
    about: str = "",
    split: str = WHOLE,
    symplectic: bool | None = None,
) -> Peer:
    why = "its two terms are q' of p alone and p' of q alone: H must be T(p) + V(q)"
    about = "; ".join(filter(None, [about, "" if split == WHOLE else f"terms: {split}"]))
    return Peer(
        f"diffrax-{id}",
        f"diffrax's {title}",
        package="diffrax",
        order=order,
        license="Apache-2.0",
        about=f"{about}; {COST}" if about else COST,
        source=source,
        run=lambda task: run_loop(lambda: _compile(name, split, task.system), task),
        claims=Claims(
            order=order,
            symplectic=symplectic,
            source=f"diffrax.{name}.order and .__doc__ of diffrax 0.7.2; {SOLVERS}",
        ),
        **(split_alone(why) if split == HALVES else {}),
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
