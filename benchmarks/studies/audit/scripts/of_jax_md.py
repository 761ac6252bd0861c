"""Scripts on JAX-MD."""

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

from jax_md import simulate  # noqa: E402


def jax_md_step():
    """The step that the integrator nve takes for dt = 0.1 in double precision, by the motion of a free particle."""
    start, step = simulate.nve(lambda R, **_: 0 * R, lambda R, dR, **_: R + dR, dt=0.1)
    state = start(None, jnp.zeros((1, 1)), 0.0, mass=1.0, momenta=jnp.ones((1, 1)))
    taken = float(step(state).position[0, 0])
    yield "type of the positions", state.position.dtype
    yield "step taken", f"{taken:.17g}"
    yield "relative difference from 0.1", f"{abs(taken / 0.1 - 1):.1e}"
