r"""BlackJAX's integrators of Hamiltonian Monte Carlo as peers, compiled by JAX in double precision.

BlackJAX integrates :math:`H = -\log\pi(q) + T(p)`: here the density's logarithm is -V.  Its implicit midpoint rule
takes a kinetic energy T(p, q), here the whole H with a constant density, and iterates until two iterates differ by less
than ``convergence_tol``: 1e-6, its default, or `CLOSE`; it takes no notice of iterations that do not converge.

Left out are the isokinetic integrators: their flows are not Hamiltonian in (q, p).

Source: A. Cabezas et al., BlackJAX: Composable Bayesian inference in JAX, arXiv:2402.10797 (2024).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from phasebench.reference.files import entries

from .jax_loop import COST, Loop, jax_function, run_loop
from .record import Claims, Peer, only, split_alone

if TYPE_CHECKING:
    import jax

    from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: Distance of iterates to which the implicit midpoint rule is solved, if not to the package's default.
CLOSE = 1e-15
DOCUMENTED = "https://blackjax-devs.github.io/blackjax/autoapi/blackjax/mcmc/integrators/index.html"
CLAIMED = f'"Symplectic, time-reversible, integrators for Hamiltonian trajectories", {DOCUMENTED}'
CANONICAL = only(
    "any canonical H",
    "it takes derivatives of H by q and p: the variables must be canonical",
    lambda system: system.canonical,
)


@lru_cache(maxsize=128)
def _compile(name: str, tol: float | None, system: Hamiltonian) -> Loop:
    """The compiled loop over the steps of BlackJAX's integrator ``name``; ``tol`` is the midpoint rule's."""
    import blackjax.mcmc.integrators as package
    import jax.numpy as jnp

    d = system.d
    if name == "implicit_midpoint":
        energy = jax_function([system.q, system.p], [system.H])
        options = {} if tol is None else {"convergence_tol": tol}

        def density(q: jax.Array) -> jax.Array:
            return 0.0 * jnp.sum(q)

        one_step = package.implicit_midpoint(density, lambda p, position: energy(position, p)[0], **options)
    else:
        potential, kinetic = (
            jax_function([of], [part]) for of, part in ((system.q, system.potential), (system.p, system.kinetic))
        )

        def density(q: jax.Array) -> jax.Array:
            return -potential(q)[0]

        one_step = getattr(package, name)(density, lambda p: kinetic(p)[0])

    def begin(y: jax.Array, h: jax.Array) -> Any:
        return package.new_integrator_state(density, y[:d], y[d:])

    def state(carried: Any) -> jax.Array:
        return jnp.concatenate([carried.position, carried.momentum])

    return Loop(d, begin, lambda k, h, carried: (one_step(carried, h), jnp.array(False)), state)


def _peer(
    id: str, name: str, title: str, order: int, gradients: int, about: str, source: str, tol: float | None = None
) -> Peer:
    split = name != "implicit_midpoint"
    why = "its kinetic energy is of the momentum, its density of the position: H must be T(p) + V(q)"
    return Peer(
        f"blackjax-{id}",
        f"BlackJAX's {title}",
        package="blackjax",
        order=order,
        license="Apache-2.0",
        about=f"{about}; {COST}",
        source=source,
        run=lambda task: run_loop(lambda: _compile(name, tol, task.system), task, gradients),
        claims=Claims(symplectic=True, reversible=True, source=f"{name}: {CLAIMED}"),
        settings={} if tol is None else {"convergence_tol": tol},
        **(split_alone(why) if split else CANONICAL),
    )


PEERS: tuple[Peer, ...] = tuple(_peer(**entry) for entry in entries(__file__))
