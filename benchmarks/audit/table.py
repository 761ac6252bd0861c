"""Format the rows of an audit: a block of lines for each integrator on the terminal, a line in the report."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

from phasebench.benchmarks.judge.evidence import LARGE, keeps_structure, kind
from phasebench.benchmarks.judge.verdict import CONTRADICTED, IN_PART
from phasebench.integrators.record import BOUNDED, DRIFT, ROUND_OFF

from .cases import BY_NAME
from .measures import GROWING_AT, TOLERANCES

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from .audit import Audit

#: Width of tables when stdout is not a terminal.
WIDTH = 100


def _uncertain(row: dict, value: str, form: str) -> str:
    return f"{row[value]:{form}} +- {(row['high'] - row['low']) / 2:{form.removeprefix('+')}}"


def letter(problem: str) -> str:
    """The letter that stands for a problem; the problem's name if it has none."""
    return BY_NAME[problem].letter if problem in BY_NAME else problem


def _order(row: dict) -> str:
    return "no window" if row.get("value") is None else _uncertain(row, "value", ".2f")


def _structure(row: dict) -> str:
    if row.get("bitwise"):
        return "0 bitwise"
    kept = keeps_structure(row) if row.get("floor") is not None else True
    return f"{row['value']:.0e}" + {True: "", False: " broken", None: " unclear"}[kept]


def _energy(row: dict) -> str:
    word = {ROUND_OFF: "round-off", BOUNDED: "bounded", DRIFT: "drifts", None: "open"}[kind(row)]
    if word == "open" and row["value"] > LARGE * row["scale"]:
        word = "large"
    return f"{row['value']:.0e} {word} {_uncertain(row, 'slope', '+.0e')}"


def _stability(row: dict) -> str:
    """The end of the first stable interval of h omega, and any later ones."""
    pieces = [tuple(map(float, piece.split(".."))) for piece in (row.get("intervals") or "").split()]
    if row.get("unconditional"):
        return f"none up to {row['value']:g}"
    if not row["value"]:
        return f"0 (x {1 + row['grows']:.4g} a step at {GROWING_AT:g})"
    first = f"{row['value']:.4g}"
    if row["reason"]:
        return f"{first}, the last that could be taken" if row["value"] >= row["scanned"] else first
    windows = [f"{a[1]:.4g} to {b[0]:.4g}" for a, b in pairwise(pieces)]
    return f"{first}; unstable on {', '.join(windows)}, then from {pieces[-1][1]:.4g}" if windows else first


def _cost(row: dict) -> str:
    return f"{row['per_time']:.3g} a unit of time" if row["value"] is None else f"{row['value']:.3g}"


def _tolerance(row: dict) -> str:
    parts = ["-" if row.get(k) is None else f"{row[k]:.0e}" for k in ERRORS]
    others = [k for k in row if k.startswith("error_") and k not in ERRORS and row[k] is not None]
    return ", ".join(parts + [f"{row[k]:.0e} at {k.removeprefix('error_')}" for k in others])


ERRORS = [f"error_{tol:.0e}" for tol in TOLERANCES]
TEXTS = {
    "order": _order,
    "tolerance": _tolerance,
    "symplecticity": _structure,
    "reversibility": _structure,
    "energy": _energy,
    "stability": _stability,
    "cost": _cost,
}
HEADS = {
    "order": "order measured",
    "tolerance": f"error at tol {', '.join(f'{tol:.0e}' for tol in TOLERANCES)}",
    "symplecticity": "symplecticity defect",
    "reversibility": "reversibility distance",
    "energy": "energy error, slope a unit of time",
    "stability": "stable to h omega",
    "cost": "us a step",
}
#: Measures made on a single problem, which is not named.
ALONE = ("stability", "cost")


def cell(rows: Iterable[dict], measure: str) -> str:
    """The results of a ``measure`` of one peer on all its problems, which are named by their letters."""
    out = []
    for row in rows:
        if row["measure"] == measure:
            text = TEXTS[measure](row) if row["status"] == "ok" else row["status"]
            out.append(text if measure in ALONE else f"{letter(row['problem'])} {text}")
    return "; ".join(out)


def lines(rows: list[dict], claims: list[dict], adaptive: bool) -> list[dict]:
    """A line for each peer of fixed or of adaptive steps: its claims beside its measurements."""
    out = []
    for id in dict.fromkeys(r["peer"] for r in rows if bool(r["adaptive"]) is adaptive):
        mine = [r for r in rows if r["peer"] == id]
        said = {c["property"]: c for c in claims if c["peer"] == id}
        first = mine[0]
        if first["status"] != "ok":
            continue
        line = {"integrator": id}
        if not adaptive:
            line["order claimed"] = said["order"]["claim"].removeprefix("order ") if "order" in said else "-"
        for measure, head in HEADS.items():
            if measure in (("order", "symplecticity", "stability") if adaptive else ("tolerance",)):
                continue
            text = cell(mine, measure)
            name = {"symplecticity": "symplectic", "reversibility": "reversible"}.get(measure, measure)
            if name in said and measure != "order" and not adaptive:
                text = f"claimed {said[name]['claim']}: {text}" if text else f"claimed {said[name]['claim']}"
            line[head] = text or "-"
        wrong = [f"{c['claim']} {c['verdict']}" for c in said.values() if c["verdict"] in (CONTRADICTED, IN_PART)]
        bad = [f"{r['measure']} {r['status']}" for r in mine if r["status"] != "ok"]
        line["status"] = "; ".join(dict.fromkeys([*wrong, *bad])) or "ok"
        out.append(line)
    return out


def show(found: Audit, console: Console | None = None) -> None:
    """Print an `Audit`: the measures of each integrator, every claim with its verdict, failures, contradictions."""
    from rich.console import Console

    console = console or Console()
    if not console.is_terminal:
        stated = os.environ.get("COLUMNS", "")
        console = Console(file=console.file, width=int(stated) if stated.isdigit() else WIDTH)
    tell = partial(console.print, markup=False, highlight=False)
    problems = dict.fromkeys(r["problem"] for r in found.rows if r["problem"])
    tell(f"problems: {', '.join(f'{letter(p)} {p}' for p in problems)}")
    for title, adaptive in (("fixed steps", False), ("adaptive steps", True)):
        for line in lines(found.rows, found.claims, adaptive):
            tell(f"\n{line.pop('integrator')}, {title}: {line.pop('status')}")
            console.print(_pairs(line))
    console.print()
    _show_claims(found.claims, console)
    for row in found.rows:
        if row["status"] != "ok":
            where = f"{row['measure']} on {row['problem']}" if row["problem"] else row["measure"]
            tell(f"{row['peer']}: {where}: {row['status']}: {row['reason']}")
    for remark in found.remarks:
        tell(remark)
    tell(f"{len(found.claims)} claims, {len(found.contradictions)} contradicted")
    for c in found.contradictions:
        tell(f"{c['peer']} {c['version']}: '{c['claim']}' ({c['source']})")


def _pairs(line: dict) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None, padding=(0, 2, 0, 2))
    for head, text in line.items():
        if text != "-":
            table.add_row(Text(head), Text(text.replace("; ", "\n")))
    return table


def _show_claims(claims: list[dict], console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    if not claims:
        return
    table = Table(title="claims", title_justify="left", header_style="bold", box=None, padding=(0, 2, 0, 0))
    for head in ("integrator", "claim", "verdict", "measured"):
        table.add_column(head, overflow="fold")
    for c in claims:
        style = "bold red" if c["verdict"] == CONTRADICTED else ""
        said = c["measured"].replace("; ", "\n") + (f"\n{c['reason']}" if c["reason"] else "")
        table.add_row(*(Text(x, style) for x in (c["peer"], c["claim"], c["verdict"], said.strip())))
    console.print(table)
