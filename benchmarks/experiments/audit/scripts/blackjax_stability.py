"""BlackJAX's stability intervals: the largest h with |tr M| <= 2 up to it, M a step on H = (p^2 + q^2) / 2."""

import blackjax.mcmc.integrators as package
import jax
import numpy as np

jax.config.update("jax_enable_x64", True)
steps = np.linspace(0, 6, 60_001)[1:]


def limit(integrator):
    def density(q):
        return -(q**2) / 2

    step = integrator(density, lambda p: p**2 / 2)

    def trace(h):
        ends = [step(package.new_integrator_state(density, q, p), h) for q, p in ((1.0, 0.0), (0.0, 1.0))]
        return ends[0].position + ends[1].momentum

    beyond = np.abs(np.asarray(jax.jit(jax.vmap(trace))(steps))) > 2 + 1e-7
    return steps[int(beyond.argmax())] if beyond.any() else np.inf


for name in ("velocity_verlet", "yoshida", "mclachlan"):
    print(f"largest stable step of {name} = {limit(getattr(package, name)):.3f}")
