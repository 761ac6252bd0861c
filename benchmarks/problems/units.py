"""Units of length, time and mass, the constant of gravity in them, and times such as "1e4 yr"."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import NamedTuple

from phasebench.integrators.errors import InvalidInput, unknown_name

#: Lengths in AU (of exactly 149,597,870.7 km), times in days, masses in solar masses.
LENGTHS = {"AU": Fraction(1), "km": Fraction(10, 1_495_978_707), "m": Fraction(1, 149_597_870_700)}
TIMES = {"day": Fraction(1), "yr": Fraction("365.25"), "s": Fraction(1, 86400)}
TIMES |= {"h": Fraction(1, 24), "min": Fraction(1, 1440)}
#: The nominal G M of Sun, Jupiter and Earth in m^3/s^2 (IAU 2015, resolution B3), and G in m^3/(kg s^2) (CODATA 2022).
NOMINAL = {"Msun": Fraction("1.3271244e20"), "Mjup": Fraction("1.2668653e17"), "Mearth": Fraction("3.986004e14")}
NOMINAL |= {"kg": Fraction("6.67430e-11")}
MASSES = {name: value / NOMINAL["Msun"] for name, value in NOMINAL.items()}
#: AU^3 / (Msun day^2).
G = Fraction("2.95912208286e-4")
#: Other words for a unit of time, and multiples.
WORDS = {"d": ("day", 1), "days": ("day", 1), "year": ("yr", 1), "years": ("yr", 1), "yrs": ("yr", 1)}
WORDS |= {"kyr": ("yr", 1000), "Myr": ("yr", 10**6), "Gyr": ("yr", 10**9)}


class Units(NamedTuple):
    """The names of a system's units of length, time and mass, such as "AU", "day", "Msun"."""

    length: str = "AU"
    time: str = "day"
    mass: str = "Msun"

    @property
    def G(self) -> float:
        """The constant of gravity in these units."""
        return float(G * MASSES[self.mass] * TIMES[self.time] ** 2 / LENGTHS[self.length] ** 3)


def units(text: str, where: str) -> Units:
    """Parse a text such as "AU, day, Msun", in any order; raise InvalidInput unless there is one unit of each kind."""
    kinds = {"length": LENGTHS, "time": TIMES, "mass": MASSES}
    found: dict[str, str] = {}
    for word in filter(None, (x.strip() for x in re.split(r"[,\s]+", text))):
        kind = next((k for k, members in kinds.items() if word in members), None)
        if kind is None:
            raise InvalidInput(
                f"{where}: {unknown_name('unit', word, [u for members in kinds.values() for u in members])}"
            )
        if kind in found:
            raise InvalidInput(f"{where}: {found[kind]} and {word} are both units of {kind}; name one")
        found[kind] = word
    missing = [k for k in kinds if k not in found]
    if missing:
        raise InvalidInput(
            f"{where}: there is no unit of {' and '.join(missing)}; write all three, as in: units: AU, day, Msun"
        )
    return Units(**found)


def span(value: float | str | None, unit: str, what: str = "t_end") -> float | None:
    """Convert a time, a number or a text such as "1e4 yr", to a number in ``unit``; a number or None is unchanged.

    A text without a unit is in ``unit``, too; ``what`` is the argument's name, for messages.  Raises InvalidInput for
    a text that is no such time, or too large, and for a unit if the problem has none (``unit`` is "").
    """
    if not isinstance(value, str):
        return value
    parts = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*([A-Za-z]*)\s*", value)
    try:
        number, word = Fraction(repr(float(parts[1]))), parts[2]
    except (ValueError, TypeError):
        hint = "it must be a finite number, such as 100, or a time such as 1e4 yr"
        raise InvalidInput(f'{what} is "{value}"; {hint}') from None
    if not word:
        return float(number)
    if not unit:
        raise InvalidInput(f'{what} is "{value}", and this problem has no unit of time: give a number')
    base, factor = WORDS.get(word, (word, 1))
    if base not in TIMES:
        raise InvalidInput(f'{what} is "{value}": {unknown_name("unit of time", word, [*TIMES, *WORDS])}')
    try:
        return float(number * factor * TIMES[base] / TIMES[unit])
    except OverflowError:
        raise InvalidInput(f'{what} is "{value}": in {unit} that is beyond the doubles') from None
