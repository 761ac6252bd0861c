"""Polished numbers of tables in a JSON file beside the tables' module, each with its table's digest (`PolishedFile`).

Polished numbers are the solution of the order conditions that is nearest to the published numbers.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import mpmath

from phasebench.integrators.errors import unknown_name

from .fractions import DIGITS
from .order_conditions import excess, residuals
from .polish import polish, starting_values
from .table import Table, is_exact, value


def excess_of_words(table: Table, numbers: Sequence[mpmath.mpf]) -> mpmath.mpf:
    """The largest residual, in absolute value, of a splitting's or composition's order conditions at ``numbers``."""
    return excess(residuals(table.kind, table.steps(numbers), table.order), table.order)


class PolishedFile:
    """The tables of a module and the file of their polished numbers, which the module's command writes.

    Parameters
    ----------
    module : the module's full name; the file is named by its last part, with the ending .json
    tables : the module's tables
    polish : function (table) -> the solution of its order conditions that is nearest to the published numbers
    excess : function (table, numbers) -> the largest residual of its order conditions, in absolute value
    """

    def __init__(
        self,
        module: str,
        tables: Sequence[Table],
        polish: Callable[[Table], list[mpmath.mpf]] = polish,
        excess: Callable[[Table, Sequence[mpmath.mpf]], mpmath.mpf] = excess_of_words,
    ) -> None:
        self.command = f"python -m {module}"
        self.path = Path(__file__).with_name(f"{module.rpartition('.')[2]}.json")
        self.tables = {t.name: t for t in tables}
        self.polish, self.excess = polish, excess

    @cached_property
    def stored(self) -> dict[str, dict]:
        """The contents of the file: name of a table -> its dict, as from `entry`; empty if there is no file."""
        return json.loads(self.path.read_text()) if self.path.exists() else {}

    def table(self, name: str) -> Table:
        """The published table with this name; raises InvalidInput for an unknown name."""
        if name not in self.tables:
            raise unknown_name("table of coefficients", name, self.tables)
        return self.tables[name]

    def numbers(self, name: str) -> tuple[mpmath.mpf, ...]:
        """The polished numbers of a table to 60 digits, in the order of `Table.published`.

        A table that is not in the file is polished, with a warning; raises InvalidInput for an unknown name.
        """
        table, known = self.table(name), self.stored.get(name, {})
        if known.get("published") != table.digest:
            message = f"{name} is new or was edited and is polished now; to keep the numbers: {self.command}"
            warnings.warn(message, stacklevel=2)
            known = self.stored[name] = self.entry(table)
        with mpmath.workdps(DIGITS):
            return tuple(map(value, known["numbers"]))

    def steps(self, name: str) -> list:
        """The substeps of a table with the numbers that solve its order conditions: fractions, or (letter, weight)."""
        with mpmath.workdps(DIGITS):
            return self.table(name).steps(self.numbers(name))

    def write(self) -> None:
        """Write the file: polish tables that are new or were edited, print their residuals, keep the other entries."""
        data = {}
        for name, table in self.tables.items():
            data[name] = self.stored.get(name, {})
            if data[name].get("published") != table.digest:
                data[name] = self.entry(table)
                print(f"{name}: {data[name]['residual_before']} -> {data[name]['residual_after']}", flush=True)
        self.path.write_text(json.dumps(data, indent=1) + "\n")

    def entry(self, table: Table) -> dict:
        """The file's entry for a table: digest, polished numbers, residuals before and after, the largest change."""
        before, after = starting_values(table), self.polish(table)
        with mpmath.workdps(DIGITS):
            texts = [x if is_exact(x) else mpmath.nstr(y, DIGITS) for x, y in zip(table.published, after, strict=True)]
            return {
                "published": table.digest,
                "numbers": texts,
                "residual_before": mpmath.nstr(self.excess(table, before), 3),
                "residual_after": mpmath.nstr(self.excess(table, list(map(value, texts))), 3),
                "moved": mpmath.nstr(max(abs(x - y) for x, y in zip(before, after, strict=True)), 3),
            }
