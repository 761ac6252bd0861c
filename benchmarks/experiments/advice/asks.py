"""Draw `ASKS`, random requests for advice on which integrator to use, with a fixed seed.

A request names a problem, an end time, an accuracy, a quantity, and what must be conserved.  A quarter of the requests
are on formulas of H that are in no registry of problems.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

SEED, REGISTERED, FORMULAS = 11, 45, 15
QUICK = 2


class Field(NamedTuple):
    """The ranges from which requests for advice on one problem are drawn.

    Attributes
    ----------
    words : the command-line words that name the problem
    spans : the shortest and the longest end time; t_end is log-uniform between them
    finest : accuracies are log-uniform from 10^-finest to 10^-1.5
    keep : properties, such as "symplectic"; a request may ask for one of them to be conserved
    own : names of the problem's own quantities (such as "phase"), whose accuracy may be requested
    """

    words: tuple[str, ...]
    spans: tuple[float, float]
    finest: int
    keep: tuple[str, ...] = ()
    own: tuple[str, ...] = ()


def _registered_field(
    label: str, shortest: float, longest: float, finest: int, keep: Sequence[str] = (), own: Sequence[str] = ()
) -> Field:
    return Field((label,), (shortest, longest), finest, tuple(keep), tuple(own))


def _formula(H: str, q: str, p: str, shortest: float, longest: float, finest: int, keep: Sequence[str] = ()) -> Field:
    return Field(("--hamiltonian", H, f"--q={q}", f"--p={p}"), (shortest, longest), finest, tuple(keep))


#: The properties that may be requested to be conserved on most problems with a separable H.
USUAL = ("symplectic", "energy", "reversible")
REGISTRY = (
    _registered_field("harmonic-oscillator", 10, 1000, 11, ("symplectic", "energy"), ("phase",)),
    _registered_field("pendulum:swinging", 5, 1000, 10, USUAL),
    _registered_field("pendulum:rotating", 5, 300, 10, USUAL),
    _registered_field("kepler", 5, 300, 9, ("symplectic", "momentum"), ("phase",)),
    _registered_field("perturbed-kepler", 5, 500, 8, ("symplectic", "momentum"), ("perihelion",)),
    _registered_field("henon-heiles:box", 5, 1000, 10, USUAL),
    _registered_field("henon-heiles:chaotic", 5, 60, 9, ("symplectic",)),
    _registered_field("lotka-volterra:4-2", 5, 100, 9),
    _registered_field("lotka-volterra-log:2-2", 5, 100, 9, ("symplectic",)),
    _registered_field("double-pendulum:regular", 5, 100, 9, ("symplectic",)),
    _registered_field("duffing:one-well", 5, 200, 10, USUAL),
    _registered_field("duffing:both-wells", 5, 100, 10, ("symplectic",)),
    _registered_field("figure-eight", 3, 60, 9, ("symplectic", "momentum")),
    _registered_field("toda:three", 3, 80, 9, ("symplectic", "momentum")),
    _registered_field("rigid-body:around-e3", 5, 200, 10, ("symplectic",)),
    _registered_field("charged-particle", 5, 300, 9, ("symplectic",), ("drift-angle",)),
    _registered_field("schwarzschild:precessing", 20, 1000, 8, (), ("azimuth",)),
    _registered_field("fpu", 1, 20, 8, ("symplectic",)),
    _registered_field("outer-solar-system", 500, 50_000, 10, ("symplectic",), ("jupiter-longitude",)),
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


class TypedRequest(NamedTuple):
    """A request for advice as it is typed: the words that name the problem, and the options.

    Attributes
    ----------
    name : number of the request, two digits
    words : the command-line words that name the problem
    t_end : end time of the integration
    accuracy : largest error allowed in the quantity
    quantity : what has to be accurate, such as "end-state", "trajectory" or "energy"
    conserve : properties that the method must conserve, such as "symplectic"; at most one is drawn
    outside : True if the problem is a formula, in no registry
    """

    name: str
    words: tuple[str, ...]
    t_end: float
    accuracy: float
    quantity: str
    conserve: tuple[str, ...]
    outside: bool


def draw(seed: int = SEED, registered: int = REGISTERED, formulas: int = FORMULAS) -> tuple[TypedRequest, ...]:
    """Draw the given numbers of requests on registered problems and on formulas, sorted by problem."""
    rng = np.random.default_rng(seed)
    fields = [REGISTRY[k] for k in np.sort(_draw_evenly(rng, len(REGISTRY), registered))]
    outside = [OUTSIDE[k] for k in np.sort(_draw_evenly(rng, len(OUTSIDE), formulas))]
    return tuple(_ask(rng, f"{n:02d}", f, n > registered) for n, f in enumerate([*fields, *outside], 1))


def _draw_evenly(rng: np.random.Generator, members: int, wanted: int) -> np.ndarray:
    """Draw ``wanted`` indices from range(``members``) with the generator ``rng``, each equally often to within one."""
    whole, rest = divmod(wanted, members)
    return np.concatenate([np.tile(np.arange(members), whole), rng.permutation(members)[:rest]])


def _ask(rng: np.random.Generator, name: str, field: Field, outside: bool) -> TypedRequest:
    """Draw a request for advice with the generator ``rng``: span, quantity and accuracy within the ranges of ``field``.

    ``name`` becomes the request's name; ``outside`` is True if the problem is in no registry.
    """
    low, high = np.log10(field.spans)
    t_end = float(f"{10 ** rng.uniform(low, high):.3g}")
    quantity = str(rng.choice(["end-state", "end-state", "trajectory", "energy", *field.own, *field.own]))
    accuracy = float(f"{10 ** rng.uniform(-field.finest, -1.5):.1e}")
    asks_more = bool(field.keep) and rng.random() < 0.25
    conserve = (str(rng.choice(field.keep)),) if asks_more else ()
    return TypedRequest(name, field.words, t_end, accuracy, quantity, conserve, outside)


ASKS = draw()
