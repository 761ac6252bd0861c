"""diffrax's ReversibleHeun, "algebraically reversible": 1000 steps out and back with the whole solver state."""

import diffrax
import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)
term = diffrax.ODETerm(lambda t, y, args: jnp.array([y[1], -jnp.sin(y[0])]))
solver, h, start = diffrax.ReversibleHeun(), 0.05, jnp.array([1.0, 0.5])


@jax.jit
def steps(y, state, h):
    def step(_, carried):
        y, _, _, state, _ = solver.step(term, 0.0, h, carried[0], None, carried[1], False)
        return y, state

    return jax.lax.fori_loop(0, 1000, step, (y, state))


there, state = steps(start, solver.init(term, 0.0, h, start, None), h)
print(f"distance with the solver's state = {jnp.abs(steps(there, state, -h)[0] - start).max():.1e}")
afresh = solver.init(term, 0.0, -h, there, None)
print(f"distance from the end point alone = {jnp.abs(steps(there, afresh, -h)[0] - start).max():.1e}")
