"""No room of the house grows unnoticed: its lines of Python, and the share of them that are docstrings."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Folders -> (lines that they may have today, lines that are the goal, today's share of docstrings in percent, of which
#: the goal is 15, in families 20). After a cut, write the smaller number here; where a room has to grow, say why in the
#: commit.
ROOMS = {
    ("integrators/records", "integrators/coefficients"): (3400, 3400, 19),
    ("integrators/families",): (9000, 7500, 30),
    ("integrators/stepping", "integrators/values", "integrators/systems"): (8640, 6600, 25),
    ("integrators/compile",): (1600, 1000, 16),
    ("integrators",): (25830, 21000, 25),
    ("reference",): (6641, 6200, 20),
    ("benchmarks/problems", "benchmarks/measure"): (11820, 9000, 20),
    ("benchmarks/store",): (2730, 1900, 13),
    (*(f"benchmarks/{x}" for x in ("ladder", "judge", "advice", "audit", "certificate")),): (9200, 6200, 14),
    ("benchmarks/page",): (1410, 1600, 20),
    ("benchmarks/studies",): (18640, 14500, 11),
    ("benchmarks/cli",): (2670, 2100, 6),
    ("benchmarks",): (47505, 35500, 14),
    ("tests",): (22020, 17000, 6),
    ("docs", "examples", "phasebench"): (2400, 2300, 15),
}


def weight(text: str) -> tuple[int, int]:
    """(lines of a source, lines of its docstrings)."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = [n for n in ast.walk(ast.parse(text)) if isinstance(n, kinds) and ast.get_docstring(n)]
    return len(text.splitlines()), sum(n.body[0].end_lineno - n.body[0].lineno + 1 for n in nodes)


@pytest.mark.parametrize("folders", ROOMS, ids=lambda x: "+".join(x))
def test_a_room_holds_what_it_may(folders):
    most, goal, share = ROOMS[folders]
    # Folders of phasebench/ are links to others.
    paths = [p for x in folders for p in (ROOT / x).rglob("*.py") if x != "phasebench" or p.parent == ROOT / x]
    lines, words = (sum(x) for x in zip(*(weight(p.read_text()) for p in paths), strict=True))
    assert goal / 2 < lines <= most, "the folders, or the table"
    assert 100 * words <= share * lines


def test_control_docstrings_are_seen():
    assert weight('"""One."""\nx = """no"""\n\n\ndef f():\n    """Two\n    lines."""\n    return 1\n') == (8, 3)
