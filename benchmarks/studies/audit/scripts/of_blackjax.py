"""Scripts on BlackJAX."""

import blackjax.mcmc.integrators as package
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)


def blackjax_midpoint():
    """How reversible and symplectic the implicit midpoint rule is on a pendulum.

    Distance from the start after 100 steps of 0.1 there and back, and max |M^T J M - J| of a step with Jacobian M, both
    at the default tolerance and, for comparison, at convergence_tol = 1e-15.
    """
    J = np.array([[0.0, 1.0], [-1.0, 0.0]])
    density, kinetic = (lambda q: jnp.cos(q[0])), (lambda p, position: 0.5 * p[0] ** 2)
    for told, options in (("default", {}), ("1e-15", {"convergence_tol": 1e-15})):
        step = package.implicit_midpoint(density, kinetic, **options)

        def run(y, h, n, step=step):
            state = package.new_integrator_state(density, y[:1], y[1:])
            state = jax.lax.fori_loop(0, n, lambda _, s: step(s, h), state)
            return jnp.concatenate([state.position, state.momentum])

        run = jax.jit(run)
        start = np.array([1.0, 0.5])
        back = np.abs(run(run(start, 0.1, 100), -0.1, 100) - start).max()
        d = 1e-3
        ends = [(run(start + d * e, 0.1, 1) - run(start - d * e, 0.1, 1)) / (2 * d) for e in np.eye(2)]
        finer = [(run(start + d * e / 2, 0.1, 1) - run(start - d * e / 2, 0.1, 1)) / d for e in np.eye(2)]
        M = np.array([(4 * f - c) / 3 for c, f in zip(ends, finer, strict=True)]).T
        yield f"distance from the start, tolerance {told}", f"{back:.1e}"
        yield f"max |M^T J M - J|, tolerance {told}", f"{np.abs(M.T @ J @ M - J).max():.1e}"


def blackjax_stability():
    """Stability intervals: the largest h with |tr M| <= 2 up to it, M a step on H = (p^2 + q^2) / 2."""
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
        yield f"largest stable step of {name}", f"{limit(getattr(package, name)):.3f}"
