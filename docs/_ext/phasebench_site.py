"""The Sphinx extension of the site: writes the generated pages when a build begins, and runs commands.

The directive ``{command}`` of a page shows a command line and its output.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import subprocess
import sys
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive, directives

HERE = Path(__file__).parent
#: Folders that hold nothing but what is generated.
OWNED = ("methods", "problems", "packages", "reference", "reports", "_generated")
#: Width of a terminal whose output a page shows, and the seconds that a command may take.
WIDTH, LIMIT = 88, 300


class Command(Directive):
    """The directive ``{command}``, which shows a command line and what it prints.

    The command runs as it stands, in the folder of the repository; its output is kept in the cache of the notebooks
    until that is deleted.  With the option ``lines``, a number n, only the first n lines of the output are shown.
    """

    required_arguments = 1
    final_argument_whitespace = True
    option_spec = {"lines": directives.positive_int}  # noqa: RUF012

    def run(self) -> list[nodes.Node]:
        """Return one block of code: the command after a prompt, then its output."""
        line = " ".join(self.arguments[0].split())
        env = self.state.document.settings.env
        text = output(line, Path(env.config.nb_execution_cache_path) / "commands")
        shown = text.splitlines()
        if len(shown) > self.options.get("lines", len(shown)):
            shown = [*shown[: self.options["lines"]], "..."]
        block = "\n".join([f"$ {line}", *(s.rstrip() for s in shown)])
        node = nodes.literal_block(block, block)
        node["language"] = "console"
        return [node]


def output(line: str, folder: Path) -> str:
    """What a command line prints, from the cache in ``folder`` if it ran before.

    Raises RuntimeError if it fails.
    """
    path = folder / f"{hashlib.sha256(line.encode()).hexdigest()[:16]}.txt"
    if path.exists():
        return path.read_text(encoding="utf-8")
    words = shlex.split(line)
    words = [sys.executable, "-m", "phasebench", *words[1:]] if words[0] == "phasebench" else words
    run = [subprocess.run(words, cwd=HERE.parents[1], capture_output=True, text=True, timeout=LIMIT,
                          env=os.environ | {"COLUMNS": str(WIDTH), "NO_COLOR": "1"}) for _ in range(2)][-1]  # fmt: skip
    if run.returncode:
        raise RuntimeError(f"`{line}` failed: {run.stderr.strip() or run.stdout.strip()}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(run.stdout, encoding="utf-8")
    return run.stdout


def generate(app, config) -> None:
    """Write every generated page below docs/; Sphinx calls it before a build."""
    import chooser
    import methods
    import packages
    import pages
    import problems

    import reference
    import reports

    found: pages.Files = {}
    for module in (methods, problems, packages, reference, reports, chooser):
        found |= module.files()
    pages.write(HERE.parent, found, OWNED)
    reports.copy(HERE.parent)


def plain_bars(app, what, name, subject, options, lines: list[str]) -> None:
    """Escape the bars, as in |p|, of a docstring that Sphinx's autodoc reads, in the list ``lines``."""
    from pages import escape

    lines[:] = escape(lines)


def setup(app) -> dict[str, bool]:
    """Register the directive ``{command}`` and the generators with Sphinx.

    Returns the dict by which Sphinx may read and write pages in parallel.
    """
    app.setup_extension("sphinx.ext.autodoc")
    app.add_directive("command", Command)
    app.connect("config-inited", generate)
    app.connect("autodoc-process-docstring", plain_bars)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
