"""Scripts on diffrax."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from shared import order

jax.config.update("jax_enable_x64", True)


def diffrax_a_stability():
    """Whether "A-L stable" methods are A- and L-stable, by the stability function R(z) of a step on y' = z y.

    The largest |R| on the imaginary axis, which must not exceed 1, and |R| at z = -1e6, which must be small.
    """
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
        yield f"{name}, largest |R| on the imaginary axis less 1", f"{axis - 1:.1e}"
        yield f"{name}, |R| at z = -1e6", f"{far:.1e}"


def diffrax_reversible_heun():
    """ReversibleHeun, "algebraically reversible": 1000 steps out and back with the whole solver state."""
    term = diffrax.ODETerm(lambda t, y, args: jnp.array([y[1], -jnp.sin(y[0])]))
    solver, h, start = diffrax.ReversibleHeun(), 0.05, jnp.array([1.0, 0.5])

    @jax.jit
    def steps(y, state, h):
        def step(_, carried):
            y, _, _, state, _ = solver.step(term, 0.0, h, carried[0], None, carried[1], False)
            return y, state

        return jax.lax.fori_loop(0, 1000, step, (y, state))

    there, state = steps(start, solver.init(term, 0.0, h, start, None), h)
    yield "distance with the solver's state", f"{jnp.abs(steps(there, state, -h)[0] - start).max():.1e}"
    afresh = solver.init(term, 0.0, -h, there, None)
    yield "distance from the end point alone", f"{jnp.abs(steps(there, afresh, -h)[0] - start).max():.1e}"


def diffrax_sil3():
    """The order of Sil3, "3rd order in the explicit (ERK) term", where the implicit term is zero."""
    solver = diffrax.Sil3(root_finder=diffrax.VeryChord(rtol=1e-12, atol=1e-12))
    nothing = diffrax.ODETerm(lambda t, y, args: 0 * y)

    def end(terms, n, span=3.0):
        start, constant = jnp.array([1.0, 0.5]), diffrax.ConstantStepSize()
        return diffrax.diffeqsolve(terms, solver, 0.0, span, span / n, start, stepsize_controller=constant).ys[-1]

    fields = {"oscillator": lambda y: jnp.array([y[1], -y[0]]), "pendulum": lambda y: jnp.array([y[1], -jnp.sin(y[0])])}
    for name, field in fields.items():
        terms = diffrax.MultiTerm(diffrax.ODETerm(lambda t, y, args, field=field: field(y)), nothing)
        yield f"order in the explicit term on the {name}", order(lambda n, terms=terms: end(terms, n), 100)
    b, c = solver.tableau.tableaus[0].b_sol, np.array([0, *solver.tableau.tableaus[0].c])
    yield "sum of b c^2, 1/3 at order 3", f"{b @ c**2:.4f}"
