"""Whether diffrax's "A-L stable" methods are A- and L-stable, by the stability function R(z) of a step on y' = z y.

The largest |R| on the imaginary axis, which must not exceed 1, and |R| at z = -1e6, which must be small.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

jax.config.update("jax_enable_x64", True)
newton = {"root_finder": optimistix.Newton(rtol=1e-12, atol=1e-12), "root_find_max_steps": 20}


def growth(method, z, implicit_term_alone):
    A = jnp.array([[z.real, -z.imag], [z.imag, z.real]])
    term = diffrax.ODETerm(lambda t, y, args: A @ y)
    if implicit_term_alone:
        term = diffrax.MultiTerm(diffrax.ODETerm(lambda t, y, args: 0 * y), term)
    solver, y, t0, t1 = method(**newton), jnp.array([1.0, 0.0]), jnp.array(0.0), jnp.array(1.0)
    return jnp.hypot(*solver.step(term, t0, t1, y, None, solver.init(term, t0, t1, y, None), False)[0])


for name in ("Kvaerno4", "KenCarp4"):
    of = jax.jit(jax.vmap(lambda z, name=name: growth(getattr(diffrax, name), z, name.startswith("Ken"))))
    axis, far = of(1j * np.logspace(-2, 3, 400)).max(), of(np.array([-1e6 + 0j]))[0]
    print(f"{name}, largest |R| on the imaginary axis less 1 = {axis - 1:.1e}")
    print(f"{name}, |R| at z = -1e6 = {far:.1e}")
