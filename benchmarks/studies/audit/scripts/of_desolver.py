"""Scripts on desolver."""

import desolver as de
import numpy as np
from shared import defect, order, pendulum

FINE = {"rtol": 1e-13, "atol": 1e-13}


def _steps(method, n, h, y=(1.0, 0.5), **options):
    integrator, rhs = method((2,), dtype=np.dtype(float), **options), de.DiffRHS(pendulum)
    integrator.adaptation_fn = lambda _: (np.float64(h), False)  # an adaptive one keeps its step
    y, h = np.array(y), np.float64(h)
    for k in range(n):
        y = y + integrator(rhs, k * h, y, {}, h)[1][1]
    return y


def desolver_fixed_steps():
    """The steps that "Fixed Step Methods" take with dt = 0.1, when they are driven as the README says."""

    def rhs(t, state, **kwargs):
        return np.array([[0.0, 1.0], [-1.0, 0.0]]) @ state

    for name in ("RK4Solver", "GaussLegendre4", "ImplicitMidpoint", "BackwardEuler", "RadauIA3"):
        system = de.OdeSystem(rhs, y0=np.array([1.0, 0.0]), t=(0, 2 * np.pi), dt=0.1, rtol=1e-9, atol=1e-9)
        system.method = getattr(de.integrators, name)
        system.integrate()
        yield f"steps of {name}", ", ".join(f"{h:.2f}" for h in np.diff(system.t)[:4])


def desolver_lobatto_iiib_2():
    """LobattoIIIB2 says symplectic = False; how far is its step from the implicit midpoint rule's?"""
    iiib, midpoint = de.integrators.LobattoIIIB2, de.integrators.ImplicitMidpoint
    yield "LobattoIIIB2.symplectic", iiib.symplectic
    yield "ImplicitMidpoint.symplectic", midpoint.symplectic
    apart = np.abs(_steps(iiib, 1, 0.1, **FINE) - _steps(midpoint, 1, 0.1, **FINE)).max()
    yield "difference of their steps", f"{apart:.1e}"


def desolver_orders():
    """The orders that explicit classes have as __order__, measured on the pendulum at constant steps."""

    def end(name, n, span=3.0):
        return _steps(getattr(de.integrators, name), n, span / n)

    exact = end("RK1412Solver", 40)
    first = {"RK8713MSolver": 12, "BABs9o7HSolver": 40, "ABAs5o6HSolver": 40, "SymplecticEulerSolver": 100}
    for name, n in first.items():
        steps = np.array([n, 1.2 * n, 1.4 * n, 1.7 * n, 2 * n]).round().astype(int)
        errors = [np.abs(end(name, k) - exact).max() for k in steps]
        slope = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
        yield f"order of {name}, __order__ {getattr(de.integrators, name).__order__:.0f}", f"{slope:.2f}"


def desolver_radau_iia_3():
    """Does each row of RadauIIA3's table sum to its node, and which order has the table by itself?"""
    table, weights = de.integrators.RadauIIA3.tableau_intermediate, de.integrators.RadauIIA3.tableau_final[0, 1:]

    def end(n, span=3.0):
        y, h = np.array([1.0, 0.5]), span / n
        for _ in range(n):
            k = np.tile(pendulum(0, y), (2, 1))
            for _ in range(60):  # the stages by fixed-point iteration
                k = np.array([pendulum(0, y + h * row[1:] @ k) for row in table])
            y = y + h * weights @ k
        return y

    yield "last node", f"{table[1, 0]:.4f}"
    yield "sum of its row", f"{table[1, 1:].sum():.4f}"
    yield f"order, __order__ {de.integrators.RadauIIA3.__order__:.0f}", order(end, 100)


def desolver_richardson():
    """Whether the extrapolation of a symplectic method, which says symplectic, is: max |M^T J M - J| on a pendulum."""
    extrapolate, base = de.integrators.generate_richardson_integrator, de.integrators.SymplecticEulerSolver
    for rows in (2, 3, 4):
        made = extrapolate(base, richardson_iter=rows)
        yield f"defect with {rows} rows", defect(lambda y, made=made: _steps(made, 1, 0.5, y, **FINE))
    yield "symplectic", extrapolate(base).symplectic


def desolver_richardson_default():
    """How far is the step of the default extrapolation from that of the method that it extrapolates?"""
    base = de.integrators.MidpointSolver
    for rows in (2, 3):
        made = de.integrators.generate_richardson_integrator(base, richardson_iter=rows)
        apart = np.abs(_steps(made, 1, 0.5, **FINE) - _steps(base, 1, 0.5, **FINE)).max()
        yield f"difference with {rows} rows", f"{apart:.1e}"
