"""Generate the reference: the command line, the Python interface, the columns of stored rows, the statuses of runs."""

from __future__ import annotations

import inspect
from collections import Counter

import pandas as pd
import typer
from pages import Files, code, facts, fenced, paragraphs, plain, rst, stored, table, toctree

import phasebench as pb
from phasebench.benchmarks import cli
from phasebench.benchmarks.cli.spellings import LISTS, OLD
from phasebench.benchmarks.page import verdict
from phasebench.benchmarks.store import schema, tables
from phasebench.integrators import outcome
from phasebench.integrators.statuses import STATUSES


def files() -> Files:
    """All pages of the reference and their index: file name -> Markdown."""
    pages = {
        "reference/cli.md": command_line(),
        "reference/api.md": interface(),
        "reference/rows.md": rows(),
        "reference/statuses.md": statuses(),
        "_generated/statuses.md": status_table(),
        "_generated/spellings.md": spelling_table(),
        "reference/bibliography.md": "# Bibliography\n\n```{bibliography}\n:all:\n```\n",
    }
    names = [name.removeprefix("reference/").removesuffix(".md") for name in pages if name.startswith("reference/")]
    listed = "\n".join(f"- []({name}.md)" for name in names)
    pages["reference/index.md"] = f"# Reference\n\n{listed}\n\n{toctree(names)}"
    return pages


def command_line() -> str:
    """The page on the command line: a section for each command, with its help and its options."""
    parts = ["# Command line\n", "`phasebench COMMAND`, or `python -m phasebench COMMAND`.\n"]
    for name, command in typer.main.get_command(cli.app).commands.items():
        context = typer.Context(command, info_name=f"phasebench {name}")
        pieces = " ".join(piece for p in command.params for piece in p.get_usage_pieces(context))
        parts += [f"## {name}\n", rst(inspect.cleandoc(command.help or "").replace("\f", "")), ""]
        parts += [fenced(f"phasebench {name} {pieces} [OPTIONS]")]
        found = [(p, p.get_help_record(context)) for p in command.params]
        parts += [table({"argument": code(r[0]), "meaning": plain(r[1])} for p, r in found if r)]
    return "\n".join(parts)


def interface() -> str:
    """The page on the Python interface: a section for each public name of the package."""
    parts = ["# Python interface\n", "Everything here is a name of the package: `import phasebench as pb`.\n"]
    for name in pb.__all__:
        value = getattr(pb, name)
        parts.append(f"## pb.{name}\n")
        if inspect.isclass(value):
            parts.append(rst(f".. autoclass:: phasebench.{name}\n   :members:\n   :no-index:"))
        elif inspect.isroutine(value):
            parts.append(rst(f".. autofunction:: phasebench.{name}\n   :no-index:"))
        elif value is STATUSES:
            parts.append("What each status means, and what to do: [Statuses](statuses.md).\n")
        else:
            parts.append(f"{len(value)} entries; `phasebench list` shows them.\n")
    return "\n".join(parts)


def rows() -> str:
    """The page on stored rows (one run each): the columns with unit, meaning, and the share of rows that have them."""
    frame = stored("rows")
    others = ", ".join(code(c) for c in frame if c not in schema.COLUMNS)
    about, provenance = paragraphs(schema.__doc__ or ""), paragraphs(tables.__doc__ or "")[1]
    groups = {
        "What was run": schema.IDENTITY,
        "How it ended": schema.OUTCOME,
        "Errors": schema.ERRORS,
        "Provenance": schema.PROVENANCE,
    }
    parts = ["# Rows\n", f"This is version {schema.VERSION} of the schema.\n", *(rst(text) for text in about[1:])]
    parts += [
        "Units are those of the row's problem: *time*, *energy*, and *state* (the largest of q and p). "
        "A plain number or a count has the unit 1.\n"
    ]
    for title, columns in groups.items():
        parts += [f"## {title}\n", table(_column(frame, name, c) for name, c in columns.items())]
    parts += [
        f"A column {code('NAME' + schema.INVARIANT)} is the {schema.OF_INVARIANT.meaning}: {others}.\n",
        rst(provenance),
        "## The stored rows\n",
        f"{len(frame)} rows of the last run; by status:\n",
        table({"status": code(s), "rows": n} for s, n in Counter(frame["status"]).most_common()),
    ]
    return "\n".join(parts)


def _column(frame: pd.DataFrame, name: str, column: schema.Column) -> dict[str, str]:
    """A line of the table of columns: name, unit, meaning, and the share of the rows of ``frame`` that have a value."""
    filled = f"{frame[name].notna().mean():.0%}" if name in frame else ""
    return {"column": code(name), "unit": column.unit, "meaning": column.meaning, "filled": filled}


def spelling_table() -> str:
    """A Markdown table of renamed command-line options: the command, the option's former name and its present one."""
    return table(
        {"command": code(command), "before": code(old), "now": code(new) + (", once for each" if old in LISTS else "")}
        for command, names in OLD.items()
        for old, new in names.items()
    )


def status_table() -> str:
    """A Markdown table of the statuses with which runs end: what happened, and what to do."""
    return table(
        {"status": code(name), "what happened": status.meaning, "what to do": status.remedy}
        for name, status in STATUSES.items()
    )


def statuses() -> str:
    """The page on the statuses of a run: a table, how "inaccurate" and "unstable" are told, what verdicts mean."""
    parts = paragraphs(outcome.__doc__ or "")
    return "\n".join(
        [
            "# Statuses\n",
            status_table(),
            "## How inaccurate and unstable are told\n",
            rst("\n\n".join(parts[1:])),
            "## Outcomes of a verdict\n",
            "A page of the reports opens with one of these.\n",
            facts({f"**{name}**": plain(meaning) for name, meaning in verdict.MEANING.items()}),
        ]
    )
