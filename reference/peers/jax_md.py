r"""JAX-MD's simulation at constant energy as a peer: particles on lines, masses of :math:`H = \sum p_i^2/2 m_i + V(q)`.

It runs in JAX's double precision.  JAX-MD rounds the step to single precision all the same (0.1 becomes
0.10000000149): a run ends at another time by up to 6e-8 of the span.

Source: S. S. Schoenholz, E. D. Cubuk, JAX, M.D.: A Framework for Differentiable Physics, NeurIPS 33 (2020).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from .forms import ON_LINES, masses
from .jax_loop import COST, Loop, jax_function, run_loop
from .record import Claims, Peer

if TYPE_CHECKING:
    import jax

    from phasebench.integrators.systems.hamiltonian import Hamiltonian


@lru_cache(maxsize=128)
def _compile(system: Hamiltonian) -> Loop:
    """The compiled loop over the steps of JAX-MD's ``simulate.nve`` on a system."""
    import jax.numpy as jnp
    from jax_md import simulate

    d, force = system.d, jax_function([system.q], system.dp)
    start, step = simulate.nve(lambda R, **_: force(R[:, 0])[:, None], lambda R, dR, **_: R + dR)
    mass = jnp.array(masses(system))

    def begin(y: jax.Array, h: jax.Array) -> Any:
        return start(None, y[:d, None], 0.0, mass=mass, momenta=y[d:, None])

    def state(carried: Any) -> jax.Array:
        return jnp.concatenate([carried.position[:, 0], carried.momentum[:, 0]])

    return Loop(d, begin, lambda k, h, carried: (step(carried, dt=h), jnp.array(False)), state)


DOCUMENTED = "https://jax-md.readthedocs.io/en/main/jax_md.simulate.html"

PEERS: tuple[Peer, ...] = (
    Peer(
        "jax-md-nve",
        "JAX-MD's simulate.nve",
        package="jax_md",
        order=2,
        license="Apache-2.0",
        about=f"velocity Verlet; the step is rounded to single precision; {COST}",
        source="Swope et al. 1982, J. Chem. Phys. 76, 637-649",
        run=lambda task: run_loop(lambda: _compile(task.system), task, 1),
        claims=Claims(energy="bounded", source=f'nve: "the energy (E) are held constant", {DOCUMENTED}'),
        **ON_LINES,
    ),
)
