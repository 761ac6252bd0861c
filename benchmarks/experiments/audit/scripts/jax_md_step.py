"""The step that JAX-MD's integrator nve takes for dt = 0.1 in double precision, by the motion of a free particle."""

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

from jax_md import simulate  # noqa: E402

start, step = simulate.nve(lambda R, **_: 0 * R, lambda R, dR, **_: R + dR, dt=0.1)
state = start(None, jnp.zeros((1, 1)), 0.0, mass=1.0, momenta=jnp.ones((1, 1)))
taken = float(step(state).position[0, 0])
print(f"type of the positions = {state.position.dtype}")
print(f"step taken = {taken:.17g}")
print(f"relative difference from 0.1 = {abs(taken / 0.1 - 1):.1e}")
