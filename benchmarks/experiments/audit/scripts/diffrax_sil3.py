"""The order of diffrax's Sil3, "3rd order in the explicit (ERK) term", where the implicit term is zero."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
solver = diffrax.Sil3(root_finder=diffrax.VeryChord(rtol=1e-12, atol=1e-12))
nothing = diffrax.ODETerm(lambda t, y, args: 0 * y)


def end(terms, n, span=3.0):
    start, constant = jnp.array([1.0, 0.5]), diffrax.ConstantStepSize()
    return diffrax.diffeqsolve(terms, solver, 0.0, span, span / n, start, stepsize_controller=constant).ys[-1]


fields = {"oscillator": lambda y: jnp.array([y[1], -y[0]]), "pendulum": lambda y: jnp.array([y[1], -jnp.sin(y[0])])}
for name, field in fields.items():
    terms = diffrax.MultiTerm(diffrax.ODETerm(lambda t, y, args, field=field: field(y)), nothing)
    ends = [end(terms, n) for n in (100, 200, 400)]
    order = np.log2(np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max())
    print(f"order in the explicit term on the {name} = {order:.2f}")
b, c = solver.tableau.tableaus[0].b_sol, np.array([0, *solver.tableau.tableaus[0].c])
print(f"sum of b c^2, 1/3 at order 3 = {b @ c**2:.4f}")
