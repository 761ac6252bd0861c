r"""diffrax's solvers of ordinary differential equations as peers, compiled by JAX, at constant steps.

The loop is diffrax's manual stepping, ``solver.step(terms, t0, t1, y, args, state, made_jump)``, inside one compiled
JAX loop.  `diffrax.diffeqsolve` with ConstantStepSize takes the same steps up to round-off: there the time is a sum of
steps, a step is the difference of two times, and rows in between are interpolated.  Here every step goes from 0 to h,
except for LeapfrogMidpoint, which stores the time before last and gets n h.

Two solvers carry more than the state between steps: LeapfrogMidpoint the previous state (its first step is Euler's),
ReversibleHeun a second copy with its slope (for the pair diffrax says "algebraically reversible").  Both are measured
from a start that is given by the state alone.

- SemiImplicitEuler takes :math:`q' = T_p(p), p' = -V_q(q)` as two terms;
- Sil3 and KenCarp3-5 take an explicit and an implicit term, here the equations of q and those of p;
- the equations of implicit solvers are solved by Optimistix's Newton method to the tolerance `ROOT`; diffrax's default,
  a chord method, takes its tolerances from an adaptive step-size control, which is not used here.

Left out are the solvers of stochastic equations, and HalfSolver, which adds an error estimate to another solver.
Double precision is switched on only during the calls made here.

Source: P. Kidger, On Neural Differential Equations, PhD thesis, University of Oxford (2021).
"""

from __future__ import annotations

import contextlib
import time
from functools import lru_cache

import numpy as np

from .record import Claims, Peer, Run, Task, anything, split_alone

#: rtol and atol for implicit equations, and the largest number of iterations.
ROOT, ITERATIONS = 1e-12, 30
#: Rows per call of the compiled loop; fixed, since the compiled code depends on it.
ROWS = 256
#: Size of the cache of compiled loops.
KEPT = 256
SOLVERS = "https://docs.kidger.site/diffrax/api/solvers/ode_solvers"

WHOLE, HALVES, IMEX = "the field", "the equations of q and of p in turn", "explicit in q, implicit in p"
IMPLICIT = ("ImplicitEuler", "Kvaerno3", "Kvaerno4", "Kvaerno5", "Sil3", "KenCarp3", "KenCarp4", "KenCarp5")


@contextlib.contextmanager
def double_precision():
    """A context that uses JAX in double precision on the CPU, in this thread only."""
    import jax

    switch = getattr(jax, "enable_x64", None)
    if not callable(switch):  # older versions of JAX
        from jax.experimental import enable_x64 as switch
    with switch(True), jax.default_device(jax.local_devices(backend="cpu")[0]):
        yield


def solver(name: str):
    """The diffrax solver of this name, with Newton's method if it is implicit."""
    import diffrax
    import optimistix

    if name not in IMPLICIT:
        return getattr(diffrax, name)()
    newton = optimistix.Newton(rtol=ROOT, atol=ROOT)
    return getattr(diffrax, name)(root_finder=newton, root_find_max_steps=ITERATIONS)


def _function(variables, expressions):
    """A function from values of the variables (one or two arrays) to a JAX array of the expressions."""
    import jax.numpy as jnp
    import sympy as sp

    evaluate = sp.lambdify(variables, list(expressions), modules="jax", cse=True)
    return lambda *values: jnp.array(evaluate(*values))


def _terms(system, split: str):
    """diffrax's terms of the system for a state (2 d,), or for `HALVES` a pair of arrays (d,)."""
    import diffrax
    import jax.numpy as jnp

    d = system.d
    if split == HALVES:
        velocity, force = _function([system.p], system.dq), _function([system.q], system.dp)
        return (
            diffrax.ODETerm(lambda t, p, args: velocity(p)),
            diffrax.ODETerm(lambda t, q, args: force(q)),
        )
    both = [system.q, system.p]
    dq, dp = _function(both, system.dq), _function(both, system.dp)
    if split == WHOLE:
        field = _function(both, [*system.dq, *system.dp])
        return diffrax.ODETerm(lambda t, y, args: field(y[:d], y[d:]))
    still = np.zeros(d)
    return diffrax.MultiTerm(
        diffrax.ODETerm(lambda t, y, args: jnp.concatenate([dq(y[:d], y[d:]), still])),
        diffrax.ODETerm(lambda t, y, args: jnp.concatenate([still, dp(y[:d], y[d:])])),
    )


@lru_cache(maxsize=KEPT)
def _compile(name: str, split: str, system):
    """(initial solver state from y and h, compiled loop over steps) of a solver, both already compiled."""
    import diffrax
    import jax
    import jax.numpy as jnp

    method, terms, multistep, d = solver(name), _terms(system, split), name == "LeapfrogMidpoint", system.d

    def first(y, h):
        y = (y[:d], y[d:]) if split == HALVES else y
        return y, method.init(terms, jnp.zeros_like(h), h, y, None)

    def loop(state, h, begin, end, index):
        """(rows (ROWS, 2 d) at the step numbers ``index``, new state, first step that failed or -1)."""
        rows = jnp.zeros((ROWS, 2 * d))

        def step(k, carried):
            (y, inner), rows, row, failed = carried
            t0, t1 = (k * h, (k + 1) * h) if multistep else (jnp.zeros_like(h), h)
            y, _, _, inner, result = method.step(terms, t0, t1, y, None, inner, False)
            wanted = index[row] == k + 1
            flat = jnp.concatenate(y) if split == HALVES else y
            rows = rows.at[row].set(jnp.where(wanted, flat, rows[row]))
            failed = jnp.where((failed < 0) & (result != diffrax.RESULTS.successful), k + 1, failed)
            return (y, inner), rows, row + wanted, failed

        state, rows, _, failed = jax.lax.fori_loop(begin, end, step, (state, rows, jnp.array(0), jnp.array(-1)))
        return rows, state, failed

    both = jax.jit(first), jax.jit(loop)
    for _ in range(2):  # the state returned by the loop may cause a second compilation
        _steps(*both, np.full(2 * d, 0.5), 1e-3, np.arange(1, ROWS + 2))
    return both


def _steps(first, loop, y, h: float, index):
    """(rows at the step numbers ``index`` up to a failure, the step that failed or -1)."""
    h, rows, begin = np.float64(h), [], 0
    state = first(y, h)
    for i in range(0, len(index), ROWS):
        part = index[i : i + ROWS]
        padded = np.full(ROWS, -1)
        padded[: len(part)] = part
        reached, state, failed = loop(state, h, begin, int(part[-1]), padded)
        failed, begin = int(failed), int(part[-1])
        rows.append(np.asarray(reached)[: len(part) if failed < 0 else int((part < failed).sum())])
        if failed >= 0:
            return np.vstack(rows), failed
    return np.vstack(rows), -1


def _build_run(name: str, split: str):
    def run(task: Task) -> Run:
        y = task.state
        with double_precision():
            first, loop = _compile(name, split, task.system)
            began = time.perf_counter()
            rows, failed = _steps(first, loop, y, task.h, np.asarray(task.numbers[1:]))
            seconds = time.perf_counter() - began
        failure = f"Newton's method fails in step {failed}" if failed > 0 else None
        return Run.of_states(np.vstack([y, rows]), task.steps, 0, seconds, failure)

    return run


_lacks_halves = split_alone("its two terms are q' of p alone and p' of q alone: H must be T(p) + V(q)")


def _peer(id, name, title, order, source, about="", *, split=WHOLE, symplectic=None) -> Peer:
    about = "; ".join(filter(None, [about, "" if split == WHOLE else f"terms: {split}"]))
    cost = f"a compiled JAX loop; the time includes its dispatch and the copying of rows, {ROWS} a call"
    return Peer(
        f"diffrax-{id}",
        f"diffrax's {title}",
        package="diffrax",
        adaptive=False,
        order=order,
        license="Apache-2.0",
        about=f"{about}; {cost}" if about else cost,
        source=source,
        run=_build_run(name, split),
        scope="H = T(p) + V(q)" if split == HALVES else "any",
        lacks=_lacks_halves if split == HALVES else anything,
        claims=Claims(
            order=order,
            symplectic=symplectic,
            source=f"diffrax.{name}.order and .__doc__ of diffrax 0.7.2; {SOLVERS}",
        ),
    )


HNW = "Hairer, Norsett & Wanner 1993, II.1"
KVAERNO = "Kvaerno 2004, BIT Numer. Math. 44, 489-502"
KENNEDY = "Kennedy & Carpenter 2003, Appl. Numer. Math. 44, 139-181"
SOLVED = f"equations solved by Newton's method to {ROOT:g}"

PEERS: tuple[Peer, ...] = (
    _peer("euler", "Euler", "Euler method", 1, HNW),
    _peer("heun", "Heun", "Heun method", 2, HNW),
    _peer("midpoint", "Midpoint", "explicit midpoint method", 2, HNW),
    _peer("ralston", "Ralston", "Ralston method", 2, "Ralston 1962, Math. Comp. 16, 431-437"),
    _peer("bosh3", "Bosh3", "Bogacki-Shampine method", 3, "Bogacki & Shampine 1989, Appl. Math. Lett. 2, 321-325"),
    _peer("tsit5", "Tsit5", "Tsitouras method", 5, "Tsitouras 2011, Comput. Math. Appl. 62, 770-775"),
    _peer("dopri5", "Dopri5", "Dormand-Prince method", 5, "Dormand & Prince 1980, J. Comput. Appl. Math. 6, 19-26"),
    _peer("dopri8", "Dopri8", "Dormand-Prince 8(7)", 8, "Prince & Dormand 1981, J. Comput. Appl. Math. 7, 67-75"),
    _peer(
        "semi-implicit-euler",
        "SemiImplicitEuler",
        "semi-implicit Euler method",
        1,
        "Hairer, Lubich & Wanner 2006, I.1.2",
        split=HALVES,
        symplectic=True,
    ),
    _peer(
        "leapfrog-midpoint",
        "LeapfrogMidpoint",
        "leapfrog/midpoint method",
        2,
        "Shampine 2009, Appl. Math. Comput. 208, 293-298",
        "two-step method, y_(n+1) = y_(n-1) + 2 h f(y_n), started by an Euler step",
    ),
    _peer(
        "reversible-heun",
        "ReversibleHeun",
        "reversible Heun method",
        2,
        "Kidger et al. 2021, Adv. Neural Inf. Process. Syst. 34",
        "it is algebraically reversible, says diffrax, which is of the state and its second copy together",
    ),
    _peer("implicit-euler", "ImplicitEuler", "implicit Euler method", 1, HNW, SOLVED),
    *(_peer(f"kvaerno{n}", f"Kvaerno{n}", f"Kvaerno method of order {n}", n, KVAERNO, SOLVED) for n in (3, 4, 5)),
    _peer(
        "sil3",
        "Sil3",
        "Whitaker-Kar method",
        2,
        "Whitaker & Kar 2013, Mon. Weather Rev. 141, 3426-3434",
        f"order 3 in the explicit term, says diffrax (on linear problems), 2 in the implicit one; {SOLVED}",
        split=IMEX,
    ),
    *(
        _peer(f"kencarp{n}", f"KenCarp{n}", f"Kennedy-Carpenter method of order {n}", n, KENNEDY, SOLVED, split=IMEX)
        for n in (3, 4, 5)
    ),
)
