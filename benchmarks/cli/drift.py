"""``drift``: the drift of a stored time series, such as an energy along a run, told apart from its oscillation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phasebench.integrators.errors import InvalidInput, unknown_name

from . import options
from .series_file import Columns, plain, read, unit_of
from .shared import WRONG, invalid_input, out, print_json

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.series import Drift

#: Names of columns, without their units, in the order in which they are taken if none is given.
TIMES = ("t", "time", "times", "step", "steps", "1")
ENERGIES = ("energy", "total energy", "toteng", "etot", "2")
KINETIC = ("kinetic energy", "kineng", "ekin", "kinetic en.")
#: What a unit of energy, or of energy per mole, is in meV (CODATA 2018), and one of time in ps.
MEV = {"ev": 1e3, "mev": 1.0, "kj/mol": 10.364269656, "kcal/mol": 43.364104242, "hartree": 27211.386246}
PS = {"fs": 1e-3, "ps": 1.0, "ns": 1e3}


def drift(
    series: Annotated[
        Path,
        typer.Argument(
            metavar="SERIES",
            help="A table: .csv, columns by blanks, a log of OpenMM, LAMMPS or ASE, GROMACS .xvg.",
        ),
    ],
    time: Annotated[
        str | None, typer.Option("--time", metavar="COLUMN", help="The column of times. Default: time or step.")
    ] = None,
    column: Annotated[
        str | None,
        typer.Option(
            "--column", metavar="COLUMN", help="The series that may drift. Default: energy or its usual names."
        ),
    ] = None,
    kinetic: Annotated[
        str | None, typer.Option("--kinetic", metavar="COLUMN", help="The kinetic energy. Default: its usual names.")
    ] = None,
    atoms: Annotated[
        int | None, typer.Option("--atoms", metavar="N", min=1, help="Print the drift for each of N atoms, too.")
    ] = None,
    energy_unit: Annotated[
        str, typer.Option("--energy-unit", metavar="UNIT", help="eV, kJ/mol, ... Default: as the column's name says.")
    ] = "",
    time_unit: Annotated[
        str,
        typer.Option("--time-unit", metavar="UNIT", help='fs, ps, ns, or so many: "2 fs". Default: as the name says.'),
    ] = "",
    as_json: options.Json = False,
) -> None:
    """Print the drift of a stored series with its interval, jumps and onsets; exit code 0 only if none is seen."""
    with invalid_input():
        columns = read(series)
        t_name = _name(series, columns, time, TIMES, "--time")
        e_name = _name(series, columns, column, ENERGIES, "--column")
        t, values = _column(series, columns, t_name), _column(series, columns, e_name)
        from phasebench.benchmarks.measure.series import drift as measured

        found = measured(t, values)
        scaled: dict[str, Any] = {}
        if atoms is not None:
            factor, unit = _meV_per_ps(energy_unit or unit_of(e_name), time_unit or unit_of(t_name))
            scaled["per_atom"] = {
                "slope": found.slope * factor / atoms,
                "interval": [x * factor / atoms for x in found.interval],
                "unit": unit,
            }
        k_name = kinetic or next((name for name in columns if plain(name) in KINETIC), None)
        if k_name is not None:
            k_name = _name(series, columns, k_name, (), "--kinetic")
            scaled["over_kinetic"] = _over_kinetic(found, t, _column(series, columns, k_name))
    if as_json:
        print_json(found.as_dict() | scaled)
    else:
        _print(found, series, e_name, scaled)
    raise typer.Exit(WRONG if found.seen else 0)


def _name(path: Path, columns: Columns, wanted: str | None, usual: tuple[str, ...], option: str) -> str:
    """The name of a column as the file has it; without its unit, too, if but one has that name."""
    if wanted is None:
        known = {plain(name): name for name in reversed(columns)}
        found = next((known[name] for name in usual if name in known), None)
        if found is None:
            raise InvalidInput(f"{path} has no column '{usual[0]}'; say {option} with one of {', '.join(columns)}")
        return found
    if wanted in columns:
        return wanted
    same = [name for name in columns if plain(name) == wanted.lower()]
    if len(same) != 1:
        raise InvalidInput(f"{path}: {unknown_name('column', wanted, columns)}")
    return same[0]


def _column(path: Path, columns: Columns, name: str) -> list[float]:
    numbers = []
    for row, text in enumerate(columns[name], 1):
        try:
            numbers.append(float(text))
        except ValueError:
            raise InvalidInput(f"{path}: '{text}' in row {row} of column '{name}' is no number") from None
    return numbers


def _meV_per_ps(energy: str, time: str) -> tuple[float, str]:
    """What a slope in units of the file is in meV/ps, with the unit's name; 1 if the file's units are not known."""
    number, _, unit = time.strip().rpartition(" ")
    energy = energy.lower().replace("mole", "mol")
    if energy not in MEV or unit.lower() not in PS:
        return 1.0, f"{energy or 'unit of the series'}/atom/{time or 'unit of time'}"
    try:
        return MEV[energy] / PS[unit.lower()] / float(number or 1), "meV/atom/ps"
    except (ValueError, ZeroDivisionError):
        raise InvalidInput(f"'{time}' is no unit of time; give one such as ps or '2 fs'") from None


def _over_kinetic(found: Drift, t: list[float], kinetic: list[float]) -> float | None:
    """The drift of the whole run in standard deviations of the kinetic energy; None if that is constant."""
    import numpy as np

    deviation = float(np.std(kinetic))
    return found.slope * abs(t[-1] - t[0]) / deviation if deviation > 0 else None


def _print(found: Drift, series: Path, column: str, scaled: dict[str, Any]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None)
    table.add_row("series", Text(f"{column} of {series}"))
    for line in found.verdicts():
        table.add_row("drift", Text(line, "bold red" if found.seen else "green"))
    table.add_row("slope", f"{found.slope:+.3e} in a unit of time{', besides these' if found.changes else ''}")
    low, high = found.interval
    table.add_row("interval", f"{low:+.3e} to {high:+.3e}, which {'holds' if found.holds_zero else 'excludes'} 0")
    if "per_atom" in scaled:
        part = scaled["per_atom"]
        low, high = part["interval"]
        table.add_row("per atom", f"{part['slope']:+.3e} {part['unit']}, {low:+.3e} to {high:+.3e}")
    if scaled.get("over_kinetic") is not None:
        table.add_row("whole run", f"{scaled['over_kinetic']:+.3e} standard deviations of the kinetic energy")
    table.add_row("oscillation", f"{found.oscillation:.3e}, half the range without the drift")
    table.add_row("method", Text(found.method))
    out.print(table, highlight=False)
