"""``validate``: judge what a user's integrator claims; exit code 0 only if every claim was seen to hold."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phasebench.integrators.errors import InvalidInput

from . import options
from .shared import WRONG, compilation_shown, invalid_input, out, print_json, say, telling, warn, width

if TYPE_CHECKING:
    from phasebench.benchmarks.certificate.result import Certificate

#: On a narrower terminal, or if the output is no terminal, claims are printed as lines, not as a table.
NARROW = 70
#: Lines are folded at this many characters.
WIDEST = 100
STYLES = {"pass": "green", "fail": "bold red", "holds": "green", "contradicted": "bold red"}


def validate(
    integrator: Annotated[
        str,
        typer.Argument(
            metavar="INTEGRATOR",
            help="./mine.py, ./mine.py:object.step, ./mine.json, package.module:callable, a method, a peer; a map.",
            autocompletion=options.completion("methods", "peers"),
        ),
    ],
    claim: Annotated[
        list[str],
        typer.Option(
            metavar="CLAIM",
            help="What it claims: order=4, symplectic, symmetric, reversible, volume, energy=bounded, ...; repeat it.",
        ),
    ] = [],  # noqa: B006
    requires: Annotated[list[str], options.requires("The integrator needs it; repeat it.")] = [],  # noqa: B006
    problem: Annotated[
        list[str],
        options.problem_option("Or your own ./mine.py. It is measured on it in place of the suite's; repeat it."),
    ] = [],  # noqa: B006
    as_map: Annotated[
        bool, typer.Option("--map", help="./mine.py has a map(q, p), of no system and without a step.")
    ] = False,
    time_limit: Annotated[
        float | None,
        options.time_limit(
            "What is not measured then is not judged; the line of a step that hangs is named. Default: no limit."
        ),
    ] = None,
    output: Annotated[Path | None, options.output("FOLDER", "A certificate: Markdown, HTML, JSON.")] = None,
    seed: Annotated[int, typer.Option(metavar="NUMBER", help="Seed of the random states at which it is measured.")] = 0,
    as_json: options.Json = False,
) -> None:
    """Measure an integrator of your own and judge what it claims; exit code 0 only for pass."""
    with invalid_input(), compilation_shown(not as_json):
        from phasebench.benchmarks.certificate.certificate import certify

        claims = stated(claim)
        if as_map and (requires or problem or time_limit is not None):
            raise InvalidInput("--map takes --claim, --output and --seed alone: a map has no system and no step")
        if seed < 0:
            raise InvalidInput(f"--seed is {seed}; it must not be negative")
        if output is not None:
            from phasebench.benchmarks.certificate.render import writable

            writable(output)
        if as_map:
            from phasebench.benchmarks.certificate.maps import certify_map

            found = certify_map(integrator, claims, seed=seed)
        else:
            with telling("validate") as tell:
                more = {"problems": tuple(problem), "time_limit": time_limit}
                found = certify(integrator, claims, tuple(requires), seed, tell, **more)
        if output is not None:
            from phasebench.benchmarks.certificate.render import write

            write(found, output)
    if as_json:
        print_json(found.as_dict())
    else:
        _print(found, output)
    raise typer.Exit(0 if found.verdict == "pass" else WRONG)


def stated(items: list[str]) -> dict[str, Any]:
    """Read --claim options: ``order=4`` as a number, ``symplectic`` or ``symplectic=true`` as True, others as text."""
    claims: dict[str, Any] = {}
    for item in items:
        name, mark, text = (x.strip() for x in item.partition("="))
        if not name or (mark and not text):
            raise InvalidInput(f"--claim {item}: write order=4, symplectic, or energy=bounded")
        if name in claims:
            raise InvalidInput(f"--claim {name} is given twice")
        claims[name] = _value(text) if mark else True
    return claims


def _value(text: str) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _print(found: Certificate, output: Path | None) -> None:
    from phasebench.benchmarks.certificate import times

    warn(times.failures(found.times))
    room = width()
    if room is None or room < NARROW:
        _say(found.summary())
    else:
        _print_table(found)
    if found.doubles:
        _say(f"measured in doubles: {found.doubles}")
    for line in times.format_costs(found.tables, found.times):
        _say(line)
    if output is not None:
        _say(f"certificate: {output / 'certificate.html'}")


def _say(text: str) -> None:
    for line in text.splitlines():
        say(folded(line))


def folded(line: str) -> str:
    """A line of output, folded at `WIDEST` characters; not one with options to be copied (--claim)."""
    if len(line) <= WIDEST or " --claim " in line:
        return line
    within = " " * (len(line) - len(line.lstrip()) + 4)
    pieces = textwrap.wrap(line, WIDEST, subsequent_indent=within, break_long_words=False, break_on_hyphens=False)
    return "\n".join(pieces)


def _print_table(found: Certificate) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table("claim", "verdict", "measured", "", box=None, padding=(0, 2, 0, 0), header_style="")
    for j in found.claims:
        measured = f"{j.measured:.3g}" if isinstance(j.measured, float) else ""
        table.add_row(j.claim, Text(j.verdict, style=STYLES.get(j.verdict, "yellow")), measured, Text(j.why))
    verdict = Text.assemble(f"{found.integrator}: ", (found.verdict, STYLES.get(found.verdict, "yellow")))
    out.print(verdict, highlight=False)
    out.print(table, highlight=False)
    if found.offers:
        _say(f"measured and not claimed: {found.claim_options()}")
