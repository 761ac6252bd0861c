r"""The periodic Toda lattice of N particles, :math:`H = \sum p_i^2/2 + \sum e^{q_i - q_{i+1}}`: integrable.

With :math:`X_i = e^{q_i - q_{i+1}}` the eigenvalues of the Lax matrix (p_i on the diagonal, 1 above it, X_i below,
X_N and 1 in the corners) are constant.  The traces of its powers k = 1, 3, ..., N, divided by k and without their
constant parts, are the N - 1 invariants besides H, which is the one of k = 2; the first is the total momentum.  For
N = 3, the other is :math:`\sum p_i^3/3 + \sum X_i(p_i + p_{i+1})`.

"cnoidal" is a travelling wave (`cnoidal`): :math:`X_n = w^2(\mathrm{sn}^{-2}\kappa - m\,\mathrm{sn}^2(\kappa n - wt))`
of parameter m with :math:`\kappa = 2K(m)/N`; w is such that the product of the X_n is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mpmath
import numpy as np
import sympy as sp

from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import unit_mass_field
from phasebench.integrators.values.kinds import Number

from .base import Orbit, Pace, Problem, decades, whole

PARAMETERS = {"N": 3}
#: The most particles: from 7 on the invariants take SymPy seconds.
LARGEST = 6
#: The parameter m of the elliptic functions of the orbit "cnoidal".
MODULUS = 0.9


def cnoidal(N: int, m: float, t: float | mpmath.mpf) -> tuple[list[mpmath.mpf], list[mpmath.mpf]]:
    """Return (q, p) of the travelling wave at time ``t``, of mean zero, in mpmath's precision; 0 < m < 1."""
    m = mpmath.mpf(m)
    kappa = 2 * mpmath.ellipk(m) / N
    sn, cn, dn = (lambda u, name=name: mpmath.ellipfun(name, u, m=m) for name in ("sn", "cn", "dn"))

    def shape(u: mpmath.mpf) -> mpmath.mpf:
        return 1 / sn(kappa) ** 2 - m * sn(u) ** 2

    w = mpmath.fprod(shape(kappa * n) for n in range(N)) ** (mpmath.mpf(-1) / (2 * N))
    u = [kappa * n - w * t for n in range(N)]
    stretch = [mpmath.log(w**2 * shape(x)) for x in u]  # q_n - q_{n+1}
    rate = [2 * w * m * sn(x) * cn(x) * dn(x) / shape(x) for x in u]  # p_n - p_{n+1}
    state = []
    for steps in (stretch, rate):
        z = [-mpmath.fsum(steps[:n]) for n in range(N)]
        state.append([x - mpmath.fsum(z) / N for x in z])
    return tuple(state)


def grad_V(sign: int = 1) -> Callable[..., None]:
    """Make the function f(q, g) that writes ``sign`` times grad V of the Toda lattice to g, for any number N."""

    def f(q: np.ndarray, g: np.ndarray) -> None:
        last = len(q) - 1
        left = first = np.exp(q[last] - q[0])
        for i in range(last):
            right = np.exp(q[i] - q[i + 1])
            g[i] = sign * (right - left)
            left = right
        g[last] = sign * (first - left)

    return f


def field() -> Callable[..., None]:
    """Make the loop f(q, p, h, lam, dq, dp) of the vector field (p, -grad V), see `systems.hand`."""
    return unit_mass_field(grad_V(-1))


def energy() -> Callable[..., tuple[Number, Number]]:
    """Make the function f(q, p) -> (H, M) of the Toda lattice; H's round-off is about M machine epsilons."""

    def f(q: np.ndarray, p: np.ndarray) -> tuple[Number, Number]:
        n = len(q)
        H = M = 0 * q[0]
        left = np.exp(q[n - 1] - q[0])
        for i in range(n):
            right = np.exp(q[i] - q[i + 1 if i < n - 1 else 0])
            v = p[i] * p[i]
            H += v / 2 + right
            M += v / 2 + right + v + abs(q[i] * (right - left))
            left = right
        return H, M

    return f


def formula(N: int) -> tuple[list[sp.Symbol], list[sp.Symbol], sp.Expr]:
    """Return (q, p, H) of the Toda lattice of N particles: lists of SymPy symbols, and H as an expression."""
    q, p = (sp.symbols([f"{x}{i + 1}" for i in range(N)], real=True) for x in "qp")
    return q, p, sp.Add(*(x**2 / 2 for x in p), *(sp.exp(q[i] - q[(i + 1) % N]) for i in range(N)))


def _traces(N: int, X: Sequence[sp.Symbol], p: Sequence[sp.Symbol]) -> dict[int, sp.Expr]:
    """k -> trace of the k-th power of the Lax matrix over k, without its constant part; X are exp(q_i - q_{i+1})."""
    L = sp.zeros(N, N)
    for i in range(N):
        L[i, i] = p[i]
        L[i, (i + 1) % N] += 1
        L[(i + 1) % N, i] += X[i]
    powers, found = sp.eye(N), {}
    for k in range(1, N + 1):
        powers = (powers * L).applyfunc(sp.expand)
        trace = sp.expand(powers.trace())
        if k == N:  # once around the lattice: N paths of ones, N of all X, whose product is 1
            trace -= N + N * sp.prod(X)
        found[k] = sp.expand(trace / k)
    return found


def make(N: int) -> Problem:
    """Make the problem of the Toda lattice of 3 <= ``N`` <= `LARGEST` particles; only N = 3 has the orbit "three"."""
    N = whole("N of particles", N, 3, LARGEST)
    q, p, X = (sp.symbols([f"{x}{i + 1}" for i in range(N)], real=True) for x in "qpX")
    bonds = dict(zip(X, (sp.exp(q[i] - q[(i + 1) % N]) for i in range(N)), strict=True))
    traces = {k: t.subs(bonds) for k, t in _traces(N, X, p).items()}
    kept = {"momentum": traces[1]} | {f"trace-{k}": traces[k] for k in range(3, N + 1)}
    with mpmath.workdps(30):
        wave = Orbit(
            "cnoidal", *(tuple(map(float, z)) for z in cnoidal(N, MODULUS, 0)), "a travelling wave", decades(100.0)
        )
    three = (Orbit("three", (1.0, 2.0, -1.0), (-1.5, 1.0, 0.5), "three particles", decades(100.0)),) if N == 3 else ()
    return Problem(
        id="toda",
        name="periodic Toda lattice",
        source="Toda 1967, J. Phys. Soc. Jpn. 22, 431-436 (the wave); Henon 1974, Phys. Rev. B 9, 1921-1923, and "
        "Flaschka 1974, Phys. Rev. B 9, 1924-1925 (the invariants); data: Hairer, Lubich & Wanner 2006, X.1",
        cite=("toda1967", "henon1974", "flaschka1974", "hairer2006"),
        system=Hamiltonian(q=q, p=p, H=sum(x**2 for x in p) / 2 + sum(bonds.values()), invariants=kept.values()),
        orbits=(*three, wave),
        invariants=kept,
        parameters={"N": N},
        pace=Pace(step=0.05, span=1.0, later=0.3),
    )
