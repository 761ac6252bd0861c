"""ASKS: sixty questions drawn at random, a seed each set, a quarter of them on problems that are in no registry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SEED, REGISTERED, FORMULAS = 11, 45, 15
QUICK = 2


class Field(NamedTuple):
    """From what asks on a problem are drawn.

    Attributes
    ----------
    words : what names the problem on a command line
    spans : the shortest and the longest, drawn evenly in their logarithms
    finest : the power of ten of the finest accuracy; the coarsest is 1e-1 of the quantity's unit, or of ``unit``
    keep : what may be asked to be conserved
    own : names of the problem's own quantities
    """

    words: tuple[str, ...]
    spans: tuple[float, float]
    finest: int
    keep: tuple[str, ...] = ()
    own: tuple[str, ...] = ()


def _registered(label: str, shortest: float, longest: float, finest: int, keep=(), own=()) -> Field:
    return Field((label,), (shortest, longest), finest, tuple(keep), tuple(own))


def _formula(H: str, q: str, p: str, shortest: float, longest: float, finest: int, keep=()) -> Field:
    return Field(("--hamiltonian", H, f"--q={q}", f"--p={p}"), (shortest, longest), finest, tuple(keep))


#: What most problems with a separable H may be asked to keep.
USUAL = ("symplectic", "energy", "reversible")
REGISTRY = (
    _registered("harmonic-oscillator", 10, 1000, 11, ("symplectic", "energy"), ("phase",)),
    _registered("pendulum:swinging", 5, 1000, 10, USUAL),
    _registered("pendulum:rotating", 5, 300, 10, USUAL),
    _registered("kepler", 5, 300, 9, ("symplectic", "momentum"), ("phase",)),
    _registered("perturbed-kepler", 5, 500, 8, ("symplectic", "momentum"), ("perihelion",)),
    _registered("henon-heiles:box", 5, 1000, 10, USUAL),
    _registered("henon-heiles:chaotic", 5, 60, 9, ("symplectic",)),
    _registered("lotka-volterra:4-2", 5, 100, 9),
    _registered("lotka-volterra-log:2-2", 5, 100, 9, ("symplectic",)),
    _registered("double-pendulum:regular", 5, 100, 9, ("symplectic",)),
    _registered("duffing:one-well", 5, 200, 10, USUAL),
    _registered("duffing:both-wells", 5, 100, 10, ("symplectic",)),
    _registered("figure-eight", 3, 60, 9, ("symplectic", "momentum")),
    _registered("toda:three", 3, 80, 9, ("symplectic", "momentum")),
    _registered("rigid-body:around-e3", 5, 200, 10, ("symplectic",)),
    _registered("charged-particle", 5, 300, 9, ("symplectic",), ("drift-angle",)),
    _registered("schwarzschild:precessing", 20, 1000, 8, (), ("azimuth",)),
    _registered("fpu", 1, 20, 8, ("symplectic",)),
    _registered("outer-solar-system", 500, 50_000, 10, ("symplectic",), ("jupiter-longitude",)),
)
OUTSIDE = (
    _formula("p**2/2 + q**4/4", "1.1", "0.2", 5, 200, 10, USUAL),
    _formula("p**2/2 - q**2/2 + q**4/4", "0.4", "0.3", 5, 150, 9, USUAL),
    _formula("p**2/2 + (1 - exp(-q))**2", "0.8", "0", 5, 200, 10, ("symplectic",)),
    _formula("(p1**2 + p2**2)/2 - cos(q1) - cos(q2) + 0.15*(q1 - q2)**2", "1,0.1", "0,0.2", 5, 100, 9, ("symplectic",)),
    _formula("(p1**2 + p2**2)/2 + (q1**4 + q2**4)/4 + 0.3*q1**2*q2**2", "0.9,0.4", "0.1,0.3", 5, 80, 8, USUAL),
    _formula("(p1**2 + p2**2)/2 - 1/sqrt(q1**2 + q2**2 + 0.1)", "1,0", "0,0.8", 5, 150, 9, ("symplectic",)),
    _formula("(p1**2 + p2**2)/2 + log(1 + q1**2 + q2**2/0.64)/2", "0.7,0.1", "0.1,0.5", 5, 150, 9, ("symplectic",)),
    _formula(
        "(p1**2 + p2**2 + p3**2)/2 + (q1**2 + q2**2 + q3**2)/2 + q1*q2*q3/5", "0.5,0.2,0.4", "0.1,0.3,0", 5, 80, 9
    ),
    _formula(
        "(p1**2 + p2**2 + p3**2 + p4**2)/2 + q1**2/2 + (q2 - q1)**2/2 + (q3 - q2)**2/2 + (q4 - q3)**2/2 + q4**2/2"
        " + ((q2 - q1)**4 + (q3 - q2)**4 + (q4 - q3)**4)/8",
        "0.6,0.1,0.3,0.2",
        "0,0.2,0.1,0",
        5,
        60,
        9,
        ("symplectic",),
    ),
    _formula("(1 + q**2/4)*p**2/2 + q**2/2", "0.9", "0.1", 5, 100, 9, ("symplectic",)),
    _formula("(p1**2 + p2**2)/2 + (q1*p2 - q2*p1)/5 + (q1**2 + 2*q2**2)/2 + q1**4/8", "0.8,0.1", "0,0.5", 5, 80, 9),
    _formula("sqrt(1 + p**2) + q**2/2", "1.2", "0", 5, 150, 9, ("symplectic",)),
    _formula("(p1**2 + p2**2)/2 + exp(q1) + exp(q2 - q1) + exp(-q2)", "0.3,-0.2", "0.4,0.1", 3, 60, 9, USUAL),
    _formula("p**2/2 + cosh(q)", "1.5", "0.1", 5, 100, 10, USUAL),
    _formula("(p1**2 + p2**2/2)/2 + 1/q1**2 + q1**2/2 + q2**2 + q1*q2**2/3", "1.1,0.3", "0.1,0.2", 3, 60, 8),
)


class Asked(NamedTuple):
    """A question as it is typed: the words that name the problem, and the options."""

    name: str
    words: tuple[str, ...]
    t_end: float
    accuracy: float
    quantity: str
    conserve: tuple[str, ...]
    outside: bool


def draw(seed: int = SEED, registered: int = REGISTERED, formulas: int = FORMULAS) -> tuple[Asked, ...]:
    """So many asks on registered problems and on formulas, those of a problem one after another."""
    rng = np.random.default_rng(seed)
    fields = [REGISTRY[k] for k in np.sort(_spread(rng, len(REGISTRY), registered))]
    outside = [OUTSIDE[k] for k in np.sort(_spread(rng, len(OUTSIDE), formulas))]
    return tuple(_ask(rng, f"{n:02d}", f, n > registered) for n, f in enumerate([*fields, *outside], 1))


def _spread(rng, members: int, wanted: int) -> np.ndarray:
    """So many of the members, each as often as any other, or once more."""
    whole, rest = divmod(wanted, members)
    return np.concatenate([np.tile(np.arange(members), whole), rng.permutation(members)[:rest]])


def _ask(rng, name: str, field: Field, outside: bool) -> Asked:
    low, high = np.log10(field.spans)
    t_end = float(f"{10 ** rng.uniform(low, high):.3g}")
    quantity = str(rng.choice(["end-state", "end-state", "trajectory", "energy", *field.own, *field.own]))
    accuracy = float(f"{10 ** rng.uniform(-field.finest, -1.5):.1e}")
    asks_more = bool(field.keep) and rng.random() < 0.25
    conserve = (str(rng.choice(field.keep)),) if asks_more else ()
    return Asked(name, field.words, t_end, accuracy, quantity, conserve, outside)


ASKS = draw()
