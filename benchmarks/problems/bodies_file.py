"""Read a file of gravitating bodies, planets.csv: comments with units and frame, column names, a row for each body."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from phasebench.integrators.errors import InvalidInput, unknown_name

from .bodies import CENTRES, FRAMES, HELIOCENTRIC, ROUND, Bodies, Oblate, bodies
from .units import units

WANTED = "# units: AU, day, Msun"
COMMENTS = ("units", "frame", "elements", "j2")


def read(path: str | Path) -> Bodies:
    """Read the bodies of a file such as planets.csv; raise InvalidInput, naming line and column, if it is unusable."""
    file = Path(path)
    if file.is_dir():
        raise InvalidInput(f"{path} is a directory; name a file .csv in it")
    if not file.exists():
        raise InvalidInput(f"there is no file {path}; write one, its first line {WANTED}")
    try:
        return parse(file.read_bytes().decode("utf-8-sig"), str(path))
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InvalidInput(f"{path} is no text in UTF-8; save it as one") from None


def parse(text: str, path: str) -> Bodies:
    """Parse a file's text to bodies; raise InvalidInput, naming the file ``path`` and the line, if it is malformed."""
    found_units, frame, about, oblate = None, None, HELIOCENTRIC, ROUND
    heads: list[str] = []
    top, stands, seen, rows = path, 0, {}, []
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        place = f"{path}, line {number}"
        if line.lstrip().startswith("#"):
            word, mark, rest = line.lstrip(" \t#").partition(":")
            word = word.strip().lower()
            if not mark or word not in COMMENTS:
                continue
            if word in seen:
                raise InvalidInput(f"{place}: the {word} are said in line {seen[word]}, too; leave one out")
            seen[word] = number
            found_units = units(rest, place) if word == "units" else found_units
            frame = rest.strip().lower() if word == "frame" else frame
            if word == "frame" and frame not in FRAMES:
                raise InvalidInput(f"{place}: {unknown_name('frame', frame, FRAMES)}")
            oblate = _oblate(f"J2: {rest}", place) if word == "j2" else oblate
            about = rest.strip().lower() if word == "elements" else about
            if word == "elements" and about not in CENTRES:
                raise InvalidInput(f"{place}: {unknown_name('centre of elements', about, CENTRES)}")
            continue
        try:
            cells = [c.strip() for c in next(csv.reader([line], skipinitialspace=True, strict=True), [])]
        except csv.Error as error:
            raise InvalidInput(f"{place}: it is no line of a CSV file: {error}") from None
        if not any(cells):
            continue
        if not heads:
            heads, top, stands = cells, place, number
            continue
        if len(cells) != len(heads):
            raise InvalidInput(
                f"{place}: it has {len(cells)} cells, and there are {len(heads)} columns (line {stands})"
            )
        rows.append((place, dict(zip(heads, cells, strict=True))))
    if not heads:
        raise InvalidInput(f"{path} is empty; write a line {WANTED}, one of columns (name, m, a, e, ...), one a body")
    if found_units is None:
        raise InvalidInput(f"{path} does not say its units; write a first line such as {WANTED}")
    return bodies(rows, found_units, frame, top, heads, about, oblate)


def _oblate(text: str, place: str) -> Oblate:
    """Read "J2: 1.6e-2, J4: -6e-4, radius: 4.8e-4"; raise InvalidInput for anything else."""
    found = {}
    for part in text.split(","):
        name, _, value = (x.strip() for x in part.partition(":"))
        if name not in Oblate._fields or name in found:
            raise InvalidInput(f"{place}: '{part.strip()}'; write J2: 1.6e-2, radius: 4.8e-4, and J4: if it is known")
        try:
            found[name] = float(value)
        except ValueError:
            raise InvalidInput(f"{place}: {name} is '{value}'; it must be a number") from None
    return Oblate(**found)
