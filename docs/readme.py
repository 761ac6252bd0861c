"""Write what README and the paper show of the suite: `python docs/readme.py`.

README's ``console`` blocks get the output of their commands; ``<!-- PAGE --> ... <!-- end -->`` of the paper the answer
of that page of `reports/`.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ANSWER = re.compile(r"<!-- ([\w-]+) -->.*?<!-- end -->", re.DOTALL)
BLOCK = re.compile(r"```console\n\$ (phasebench [^\n]*)\n.*?```", re.DOTALL)
#: Columns of the terminal, and the most lines of an output that are shown.
WIDTH, LINES = 100, 9


def output(command: str) -> str:
    """What a command line prints on a terminal of `WIDTH` columns: at most `LINES` lines, each cut at the width."""
    environment = os.environ | {"COLUMNS": str(WIDTH)}
    words = [sys.executable, "-m", "phasebench", *command.split()[1:]]
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if not done.stdout:
        raise SystemExit(f"{command} prints nothing: {done.stderr}")
    lines = [
        line.rstrip() if len(line) <= WIDTH else f"{line[: WIDTH - 4].rstrip()} ..."
        for line in done.stdout.splitlines()
    ]
    return "\n".join(lines[:LINES] + ["..."] * (len(lines) > LINES)).rstrip()


def refreshed(text: str) -> str:
    """The text of a README with the present output of the command of each ``console`` block below the command."""
    return BLOCK.sub(lambda block: f"```console\n$ {block[1]}\n{output(block[1])}\n```", text)


def answer(page: str) -> str:
    """The answer of a page of the reports, which its second paragraph gives after the outcome."""
    return " ".join((ROOT / "reports" / f"{page}.md").read_text(encoding="utf-8").split("\n\n")[1].split()[1:])


def answered(text: str) -> str:
    """The text of the paper with the present answers of the pages that it names."""
    return ANSWER.sub(lambda place: f"<!-- {place[1]} -->{answer(place[1])}<!-- end -->", text)


if __name__ == "__main__":
    for path, renewed in ((ROOT / "README.md", refreshed), (ROOT / "docs" / "paper" / "paper.md", answered)):
        path.write_text(renewed(path.read_text(encoding="utf-8")), encoding="utf-8")
