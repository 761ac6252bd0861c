"""`ASKS`: random requests for advice, with a fixed seed; a quarter are on formulas of H that are in no registry."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np

SEED, REGISTERED, FORMULAS = 11, 45, 15
#: Kind of problem -> the ranges from which its requests are drawn.
RANGES = tomllib.loads(Path(__file__).with_name("ranges.toml").read_text(encoding="utf-8"))


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


def draw(seed: int = SEED) -> tuple[TypedRequest, ...]:
    """Draw requests on registered problems, then on formulas, each sorted by problem."""
    rng = np.random.default_rng(seed)
    wanted = {"registered": REGISTERED, "formulas": FORMULAS}
    chosen = {kind: np.sort(_evenly(rng, len(RANGES[kind]), n)) for kind, n in wanted.items()}
    ranges = [(kind, RANGES[kind][k]) for kind, members in chosen.items() for k in members]
    return tuple(_request(rng, f"{n:02d}", kind == "formulas", *of) for n, (kind, of) in enumerate(ranges, 1))


def _evenly(rng: np.random.Generator, members: int, wanted: int) -> np.ndarray:
    """``wanted`` indices from range(``members``), each equally often to within one."""
    whole, rest = divmod(wanted, members)
    return np.concatenate([np.tile(np.arange(members), whole), rng.permutation(members)[:rest]])


def _request(
    rng: np.random.Generator, name: str, outside: bool, words: list, shortest: float, longest: float, finest: int,
    keep: list[str], own: list[str],
) -> TypedRequest:  # fmt: skip
    t_end = float(f"{10 ** rng.uniform(np.log10(shortest), np.log10(longest)):.3g}")
    quantity = str(rng.choice(["end-state", "end-state", "trajectory", "energy", *own, *own]))
    accuracy = float(f"{10 ** rng.uniform(-finest, -1.5):.1e}")
    asks_more = bool(keep) and rng.random() < 0.25
    conserve = (str(rng.choice(keep)),) if asks_more else ()
    return TypedRequest(name, tuple(words), t_end, accuracy, quantity, conserve, outside)


#: Name -> request.
ASKS = {request.name: request for request in draw()}
