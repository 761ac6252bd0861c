"""``validate``: what an integrator of one's own claims, judged; exit code 0 only where every claim was seen to hold."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phasebench.integrators.errors import InvalidInput

from .shared import WRONG, compilation_shown, invalid_input, out, print_json, telling, warn, width

if TYPE_CHECKING:
    from phasebench.benchmarks.certificate.result import Certificate

#: Below so many columns, and where nobody reads, a claim is a line of text.
NARROW = 70
STYLES = {"pass": "green", "fail": "bold red", "holds": "green", "contradicted": "bold red"}


def validate(
    integrator: Annotated[
        str,
        typer.Argument(
            metavar="INTEGRATOR",
            help="./mine.py, ./mine.py:object.step, ./mine.json, package.module:callable, a method, a peer.",
        ),
    ],
    claim: Annotated[
        list[str], typer.Option(help="order=4, symplectic, symmetric, reversible, energy=bounded, stability=2, ...")
    ] = [],  # noqa: B006
    requires: Annotated[list[str], typer.Option(help="A trait of systems that it needs: separable.")] = [],  # noqa: B006
    problem: Annotated[
        list[str],
        typer.Option(help="A problem, or your own ./mine.py, to measure it on in place of the suite's systems."),
    ] = [],  # noqa: B006
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds: then a step that never returns is ended, and where it was is said.")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="A folder for the certificate: Markdown, HTML, JSON.")] = None,
    seed: Annotated[int, typer.Option(help="Of the states at which it is measured.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure an integrator of your own and judge what it claims; exit code 0 only for pass."""
    with invalid_input(), compilation_shown(not as_json):
        from phasebench.benchmarks.certificate.certificate import certify

        claims = stated(claim)
        if seed < 0:
            raise InvalidInput(f"--seed is {seed}; it must not be negative")
        if output is not None:
            from phasebench.benchmarks.certificate.render import writable

            writable(output)
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
    """Claims as they are written: ``order=4`` a number, ``symplectic`` or ``symplectic=true`` true, others text."""
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
    from phasebench.benchmarks.certificate.place import placed

    warn(times.failures(found.times))
    room = width()
    if room is None or room < NARROW:
        _say(found.summary())
    else:
        _print_table(found)
    if found.doubles:
        _say(f"measured in doubles: {found.doubles}")
    for line in (*placed(found.tables), *times.said(found.times)):
        _say(line)
    if output is not None:
        _say(f"certificate: {output / 'certificate.html'}")


def _say(text: str) -> None:
    out.print(text, highlight=False, markup=False, soft_wrap=True)


def _print_table(found: Certificate) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for j in found.claims:
        measured = f"{j.measured:.3g}" if isinstance(j.measured, float) else ""
        table.add_row(j.claim, Text(j.verdict, style=STYLES.get(j.verdict, "yellow")), measured, Text(j.why))
    verdict = Text.assemble(f"{found.integrator}: ", (found.verdict, STYLES.get(found.verdict, "yellow")))
    out.print(verdict, highlight=False)
    out.print(table, highlight=False)
    if found.offers:
        _say(f"measured and not claimed: {found.offered()}")
