"""Run the commands of README's ``console`` blocks, and write their output below them: `python docs/readme.py`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
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


if __name__ == "__main__":
    readme = ROOT / "README.md"
    readme.write_text(refreshed(readme.read_text(encoding="utf-8")), encoding="utf-8")
