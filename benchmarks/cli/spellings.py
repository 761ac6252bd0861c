"""Old spellings of options: for one release they work, and a line on stderr names the new one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from typer.core import TyperCommand

from .shared import err, say

#: Command -> {old spelling: new spelling}.
OLD: dict[str, dict[str, str]] = {
    "integrate": {"--timeout": "--time-limit"},
    "advise": {"--limit": "--time-limit"},
    "workprecision": {"--methods": "--method"},
    "certify": {"--timeout": "--time-limit"},
    "compare": {"--rows": "--lines"},
    "report": {"--folder": "--reports"},
    "cite": {"--folder": "--reports"},
}
#: Old spellings whose value is a list with commas; the new spelling is repeated.
LISTS = ("--methods",)


class Command(TyperCommand):
    """A command of typer whose arguments may have old spellings."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put new spellings in place of old ones, say so on stderr, and parse the arguments."""
        args, notices = translate(args, OLD.get(self.name or "", {}))
        for notice in () if ctx.resilient_parsing else notices:
            say(notice, err)
        return super().parse_args(ctx, args)


def translate(args: list[str], old: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Replace old spellings of options in command-line arguments, also in the form ``--old=value``.

    ``old`` maps old to new spellings.  Returns the new arguments, and a notice for each old spelling found.
    """
    result: list[str] = []
    found: dict[str, str] = {}
    words = iter(args)
    for word in words:
        if word == "--":
            return [*result, word, *words], list(found.values())
        name, mark, value = word.partition("=")
        if name not in old:
            result.append(word)
            continue
        new = old[name]
        repeat = name in LISTS
        found[name] = f"{name} is now {new}" + (", once for each" if repeat else "")
        if not repeat:
            result.append(new + mark + value)
            continue
        items = value if mark else next(words, "")
        result += [part for item in items.split(",") if item.strip() for part in (new, item.strip())]
    return result, list(found.values())
