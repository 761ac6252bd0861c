"""A tuple of objects that can also be indexed by their ids (`Records`), and usual names of methods with their ids."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable
from typing import Any, SupportsIndex, TypeVar, overload

from .errors import InvalidInput, unknown_name

T = TypeVar("T")

#: A name of the field, in small letters and digits alone -> ids of the method that it means, or of those it may mean.
ALIASES: dict[str, tuple[str, ...]] = {
    "euler": ("explicit-euler", "symplectic-euler-p"),
    "forwardeuler": ("explicit-euler",),
    "backwardeuler": ("implicit-euler",),
    "symplecticeuler": ("symplectic-euler-p", "symplectic-euler-q"),
    "semiimpliciteuler": ("symplectic-euler-p", "symplectic-euler-q"),
    "eulercromer": ("symplectic-euler-p", "symplectic-euler-q"),
    "lietrotter": ("symplectic-euler-p", "symplectic-euler-q"),
    "midpoint": ("implicit-midpoint",),
    "verlet": ("stormer-verlet",),
    "stormer": ("stormer-verlet",),
    "stoermerverlet": ("stormer-verlet",),
    "velocityverlet": ("stormer-verlet",),
    "leapfrog": ("stormer-verlet", "stormer-verlet-dkd", "rebound-leapfrog"),
    "strang": ("stormer-verlet", "stormer-verlet-dkd"),
    "strangsplitting": ("stormer-verlet", "stormer-verlet-dkd"),
    "kdk": ("stormer-verlet",),
    "kickdriftkick": ("stormer-verlet",),
    "dkd": ("stormer-verlet-dkd",),
    "driftkickdrift": ("stormer-verlet-dkd",),
    "positionverlet": ("stormer-verlet-dkd",),
    "rungekutta": ("rk4", "dop853"),
    "rungekutta4": ("rk4",),
    "classicalrungekutta": ("rk4",),
    "kutta4": ("rk4",),
    "dopri853": ("dop853", "scipy-dop853"),
    "ruth4": ("forest-ruth",),
    "forestruth4": ("forest-ruth",),
    "neri4": ("forest-ruth",),
    "candyrozmus": ("forest-ruth",),
    "candyrozmus4": ("forest-ruth",),
    "triplejump": ("forest-ruth",),
    "yoshida": ("forest-ruth", "yoshida-6a", "yoshida-8d"),
    "yoshida4": ("forest-ruth",),
    "yoshida6": ("yoshida-6a", "yoshida-6b", "yoshida-6c"),
    "yoshida8": ("yoshida-8a", "yoshida-8b", "yoshida-8c", "yoshida-8d", "yoshida-8e"),
    "suzuki": ("suzuki-4",),
    "mclachlan": ("mclachlan-s2", "mclachlan-s4", "mclachlan-s5", "mclachlan-ss5", "mclachlan-ss17"),
    "mclachlan2": ("mclachlan-s2", "mclachlan-atela-2"),
    "mclachlan4": ("mclachlan-s4", "mclachlan-s5", "mclachlan-ss5", "mclachlan-sb3a4"),
    "mclachlan6": ("mclachlan-ss9",),
    "mclachlan8": ("mclachlan-ss17",),
    "omelyan": ("pefrl",),
    "omelyan4": ("pefrl",),
    "kahanli": ("kahan-li-6", "kahan-li-8"),
    "blanesmoan": ("blanes-moan-s6", "blanes-moan-s10", "blanes-moan-srkn6b", "blanes-moan-srkn11b"),
    "blanesmoan4": ("blanes-moan-s6", "blanes-moan-srkn6b"),
    "blanesmoan6": ("blanes-moan-s10", "blanes-moan-srkn11b", "blanes-moan-srkn14a"),
    "gausslegendre": ("gauss-2", "gauss-3", "gauss-4"),
    "gausslegendre2": ("implicit-midpoint", "gauss-2"),
    "gausslegendre4": ("gauss-2", "gauss-4"),
    "gausslegendre6": ("gauss-3", "gauss-6"),
    "discretegradient": ("gonzalez", "itoh-abe", "avf"),
    "averagedvectorfield": ("avf",),
    "respa": ("r-respa",),
    "wh": ("wisdom-holman", "rebound-whfast"),
    "whfast": ("rebound-whfast", "wisdom-holman"),
    "ias15": ("rebound-ias15",),
    "taylor": ("heyoka",),
}


def normalize(name: str) -> str:
    """The name in lower case without accents, letters and digits only, for comparison."""
    letters = unicodedata.normalize("NFKD", name).casefold()
    return "".join(c for c in letters if c.isascii() and c.isalnum())


def unknown_method(name: str, known: Iterable[str], kind: str = "method") -> InvalidInput:
    """Make the error for an unknown method; its message lists the ids that the name may stand for, or the nearest ids.

    ``known`` are the known ids; usual names, such as "leapfrog", are looked up in `ALIASES`.
    """
    known = list(known)
    wanted = normalize(name)
    meant = [id for id in known if normalize(id) == wanted]
    meant += [id for id in ALIASES.get(wanted, ()) if id in known and id not in meant]
    if not meant:
        return unknown_name(kind, name, known)
    return InvalidInput(f"there is no {kind} '{name}'; did you mean {' or '.join(meant)}?")


class Records(tuple[T, ...]):
    """A tuple of records (objects with an ``id``, such as methods): ``records["rk4"]`` is the record with that id.

    ``"rk4" in records`` tells whether there is one.
    """

    _find: Callable[[Any], T]

    @classmethod
    def of(cls, records: Iterable[T], find: Callable[[Any], T]) -> Records[T]:
        """Make the tuple of ``records``; ``find(id)`` returns a record, or raises InvalidInput for an unknown id."""
        made = cls(records)
        made._find = find
        return made

    @overload  # type: ignore[override]
    def __getitem__(self, key: SupportsIndex | str) -> T: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[T, ...]: ...
    def __getitem__(self, key: SupportsIndex | slice | str) -> T | tuple[T, ...]:
        """The record at a position or with an id; for a slice, a part of the tuple."""
        return self._find(key) if isinstance(key, str) else super().__getitem__(key)

    def __contains__(self, key: object) -> bool:
        """True if ``key``, a record or the id of a record, is in the tuple."""
        return any(getattr(r, "id", None) == key for r in self) if isinstance(key, str) else super().__contains__(key)
