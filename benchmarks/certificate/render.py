"""The certificate as files: ``certificate.md``, ``.html`` (one self-contained file), ``.json``, and its figures."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import BROKEN, GATE, VISIBLE
from phasebench.benchmarks.judge.requirements import REQUIRED
from phasebench.benchmarks.judge.verdict import CONTRADICTED, FAIL, HOLDS, OPEN, PASS, UNJUDGED
from phasebench.benchmarks.page import html, markdown
from phasebench.benchmarks.page.markdown import bullets, number, wrap
from phasebench.benchmarks.page.page import Picture
from phasebench.benchmarks.store.json_text import json_text
from phasebench.integrators.errors import InvalidInput

from . import figures
from .adaptive import T_END
from .battery import BY_TRAIT, entries
from .result import Certificate
from .stepping import DIGITS
from .structure import STEPS

PLACE = (
    "Evaluations of the gradient, by q or by p, whichever are more, that it needs for an error of the state at the "
    "end (of its worst component), and the fewest of the trade's integrators that come within twice the cheapest in "
    "time. Times are of the machine and of the moment: the command prints them, and certificate.json has them."
)
WORDS = {HOLDS: "hold", CONTRADICTED: "contradicted", UNJUDGED: "not judged"}
TITLES = {PASS: "PASS", FAIL: "FAIL", OPEN: "NOT JUDGED"}


def write(certificate: Certificate, folder: str | Path) -> list[Path]:
    """Write a certificate as JSON, Markdown and HTML with its figures into a folder; return the three paths."""
    folder = writable(folder)
    try:
        drawings = [d for d in (draw(certificate.tables) for draw in figures.DRAWINGS.values()) if d is not None]
        pictures = [Picture(style.save(d.figure, folder / "figures", d.file), d.title, d.caption) for d in drawings]
        text = document(certificate, pictures)
        files = {
            "certificate.json": json_text(certificate.as_dict(), indent=1) + "\n",
            "certificate.md": text,
            "certificate.html": html.document(text, folder, home=None),
        }
        for name, content in files.items():
            (folder / name).write_text(content, encoding="utf-8")
    except OSError as error:
        raise _unwritable(folder, error) from None
    return [folder / name for name in files]


def writable(folder: str | Path) -> Path:
    """Make the folder if missing and check that it can be written to; raises InvalidInput if not."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise _unwritable(folder, error) from None
    return folder


def _unwritable(folder: Path, error: OSError) -> InvalidInput:
    return InvalidInput(f"the certificate cannot be written to {folder}: {error.strerror}")


def document(certificate: Certificate, pictures: Iterable[Picture]) -> str:
    """The certificate as a Markdown text, with links to its figures."""
    parts = [
        f"# Certificate: {certificate.integrator}\n",
        f"**{TITLES[certificate.verdict]}**\n",
        _sentence(certificate),
        wrap(unseen(certificate)) + "\n",
    ]
    parts += ["\n## Claims\n", markdown.table(_claims(certificate))]
    if certificate.offers:
        parts.append(wrap(f"Measured and not claimed: {', '.join(certificate.offers)}.") + "\n")
    for picture in pictures:
        parts += [f"![{picture.title}](figures/{picture.file})\n", wrap(picture.caption) + "\n"]
    measured = _systems_table(certificate)
    if len(measured):
        parts += ["## Measured\n", markdown.table(measured)]
    if certificate.tables.of("place"):
        parts += ["## Place on fronts of the trade\n", wrap(PLACE) + "\n", markdown.table(_place(certificate))]
    parts += ["## How it was judged\n", bullets(_limits(certificate))]
    return "\n".join(parts).rstrip() + "\n"


def _sentence(certificate: Certificate) -> str:
    whole, counts = len(certificate.claims), {v: sum(j.verdict == v for j in certificate.claims) for v in WORDS}
    told = f"Of {whole} claims and requirements {', '.join(f'{n} {WORDS[v]}' for v, n in counts.items() if n)}."
    if counts[HOLDS] == whole:
        told = f"All {whole} claims and requirements hold."
    if whole <= len(REQUIRED):
        told += " Nothing was claimed beyond what every integrator is held to."
    why = [f"{j.claim}: {j.why or j.verdict}" for j in certificate.claims if j.verdict == CONTRADICTED]
    return wrap(told + (f" Contradicted: {'; '.join(why)}." if why else "")) + "\n"


def _claims(certificate: Certificate) -> pd.DataFrame:
    rows = []
    for j in certificate.claims:
        interval = f"{j.interval[0]:.5g} to {j.interval[1]:.5g}" if j.interval else ""
        value = number(j.measured) if isinstance(j.measured, (int, float)) else j.measured or ""
        row = {"claim": j.claim, "verdict": j.verdict, "measured": value, "interval": interval}
        rows.append(row | {"on": ", ".join(j.on), "why": j.why[:200]})
    return pd.DataFrame(rows)


def _systems_table(certificate: Certificate) -> pd.DataFrame:
    tables = certificate.tables
    rows: dict[str, dict] = {}
    for r in tables.of("runs"):
        if "dH_dq" in r:
            rows.setdefault(r["on"], {})["dH/dq, dH/dp a step"] = f"{number(r['dH_dq'])}, {number(r['dH_dp'])}"
    for r in tables.of("order"):
        rows.setdefault(r["on"], {})["order"] = f"{r['value']:.3f} [{r['low']:.3f}, {r['high']:.3f}]"
        rows[r["on"]]["digits"] = "16" if r["arithmetic"] == "double" else str(DIGITS)
    for name in ("symplectic", "symmetric", "reversible", "volume"):
        for r in tables.of(name):
            rows.setdefault(r["on"], {})[f"{name} defect"] = number(r["value"]) if "value" in r else "not measured"
    for r in tables.of("long"):
        if r["status"] == "ok":
            rows.setdefault(r["on"], {})["energy error, in units of H"] = number(r["energy"]["value"])
            rows[r["on"]]["its slope, per unit of time"] = number(r["energy"]["slope"])
    for r in tables.of("tolerance"):
        at = ", ".join(f"{tol:.0e}" for tol in r["tolerances"])
        rows.setdefault(r["on"], {})[f"relative errors at tolerances {at}"] = ", ".join(number(e) for e in r["errors"])
    return pd.DataFrame([{"system": name} | row for name, row in rows.items()]).fillna("")


def _place(certificate: Certificate) -> pd.DataFrame:
    rows = []
    for r in certificate.tables.of("place"):
        for e in r["errors"]:
            mine = {"evaluations": "not reached", "times as many": ""}
            if e["evaluations"] is not None:
                mine = {"evaluations": f"{e['evaluations']:.0f}", "times as many": f"{e['factor']:.2g}"}
            row = {"scene": r["on"], "error up to": f"{e['error']:.0e}", "evaluations": mine["evaluations"]}
            row |= {"cheapest stored": e["cheapest"], "its evaluations": f"{e['its evaluations']:.0f}"}
            rows.append(row | {"times as many": mine["times as many"]})
    return pd.DataFrame(rows)


def unseen(certificate: Certificate) -> str:
    """Sentences on where the integrator was measured, outside of which nothing is seen."""
    rows = certificate.tables.of("order") or certificate.tables.of("symplectic")
    names = list(dict.fromkeys(r["on"] for r in rows))
    battery = {e.name: e.system.d for of in (entries, *BY_TRAIT.values()) for e in of()}
    systems = ", ".join(names) or "no system"
    if names and set(names) <= set(battery):
        dimensions = ", ".join(map(str, sorted({battery[name] for name in names})))
        systems = f"small systems of {dimensions} degrees of freedom"
    text = f"Measured on {systems}: what shows on others alone is not seen."
    for r in certificate.tables.of("reach"):
        h, q, p = (f"{number(r[name][0])} to {number(r[name][1])}" for name in "hqp")
        text += (
            f" In doubles {r['steps']} steps were drawn with h from {h}, |q| from {q}, |p| from {p} and up to "
            f"{max(r['d'])} degrees of freedom: not seen is what shows beyond, between them, or after more than the "
            f"{r['calls']} calls made."
        )
    return text


def _limits(certificate: Certificate) -> list[str]:
    about = certificate.as_dict()
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    out = []
    if any(certificate.tables.of(name) for name in ("order", "tolerance", "symplectic")):
        out.append(f"Arithmetic: {about['arithmetic']}."[:380])
    if certificate.tables.of("order"):
        out.append(
            f"An order agrees within {GATE}; it is that of the worst system. A defect over {BROKEN:g} times the floor "
            f"is broken; below it counts where the step's own error is {VISIBLE:g} times the floor. Steps h = "
            f"{' and '.join(f'{h:g}' for h in STEPS)}."
        )
    if certificate.tables.of("tolerance"):
        out.append(f"Errors are relative to the largest component of the state, after {T_END:g} units of time.")
    for r in certificate.tables.of("round_off"):
        grows = (
            "its mean is not 0: it adds up as t"
            if r["biased"]
            else "its mean is 0 as far as can be seen: as the root of t"
        )
        text = f"Round-off of a step in the energy, in units of 2.2e-16 of it: {number(r['deviation'])}, mean"
        out.append(f"{text} {number(r['mean'])} over {r['steps']} steps on {r['on']}: {grows}.")
    for r in certificate.tables.of("stability"):
        limit = r["reason"] or (
            f"stable as far as {number(r['scanned'])}" if r["limit"] is None else number(r["limit"])
        )
        out.append(f"Linear stability limit, in h omega: {limit}.")
    return [*out, f"Seed {certificate.seed}; {versions}. Made again, it is the same but for the seconds it takes."]
