"""Generate a page for each audited package: its version, its integrators, and what was claimed and measured."""

from __future__ import annotations

from collections import Counter

import pandas as pd
from pages import Files, code, facts, fenced, fold, plain, stored, table, toctree

from phasebench.reference.peers import PEERS


def files() -> Files:
    """The pages of the packages and their index: file name -> Markdown."""
    names = list(dict.fromkeys(p.package for p in PEERS))
    pages = {f"packages/{name}.md": page(name) for name in names}
    rows = []
    for name in names:
        claims = Counter(_rows("audit_claims", name)["verdict"])
        said = Counter(_rows("audit_statements", name)["verdict"])
        rows.append(
            {
                "package": f"[{name}]({name}.md)",
                "version": version(name),
                "integrators": sum(p.package == name for p in PEERS),
                "claims that hold": claims["holds"],
                "claims contradicted": claims["contradicted"],
                "statements tested": sum(said.values()),
                "statements contradicted": said["contradicted"],
            }
        )
    head = (
        "# Audited packages\n\nWhat established packages claim of their integrators, and what was measured; "
        "[the audit](../reports/audit.md) says how. A claim is of the version named.\n\n"
    )
    pages["packages/index.md"] = head + table(rows) + "\n" + toctree(names)
    return pages


def _rows(name: str, package: str) -> pd.DataFrame:
    frame = stored(name)
    return frame[frame["package"] == package]


def version(package: str) -> str:
    """The version or versions of a package that were audited, as text."""
    return ", ".join(str(v) for v in _rows("audit", package)["version"].dropna().unique())


def page(package: str) -> str:
    """The site's page of a package whose integrators are compared with ours, as Markdown; ``package`` is its name."""
    peers = [p for p in PEERS if p.package == package]
    parts = [
        f"# {package}\n",
        facts({"Audited version": version(package), "Licence": peers[0].license, "Integrators": str(len(peers))}),
        "## Claimed and measured\n",
        claims(package),
        "## Statements of its documentation\n",
        statements(package),
        "## Integrators\n",
        _integrators(peers),
    ]
    left_out = _rows("audit_unregistered", package)
    if len(left_out):
        names = ", ".join(code(str(name)) for name in left_out["name"].dropna())
        parts += ["## Not audited\n", f"{names or 'Nothing'}.\n"]
    return "\n".join([*parts, "## Audit it\n", fenced(f"phasebench audit --peer {peers[0].id}")])


def claims(package: str) -> str:
    """Markdown on what a package claims of its integrators: counts of the verdicts, then tables.

    The first table has the claims that are contradicted or understated (more holds than is claimed), the second, which
    is folded, all claims.
    """
    found = _rows("audit_claims", package)
    if found.empty:
        return "It claims no order, symplecticity, reversibility or energy behaviour.\n"
    count = Counter(found["verdict"])
    rows = [
        {
            "integrator": code(r.peer),
            "claim": plain(r.claim),
            "verdict": plain(r.verdict),
            "measured": plain(r.measured if pd.notna(r.measured) else r.reason),
        }
        for r in found.sort_values("verdict", kind="stable").itertuples()
    ]
    worst = [row for row in rows if row["verdict"] in ("contradicted", "understated")]
    summary = ", ".join(f"{word} {number}" for word, number in sorted(count.items()))
    return "\n".join(
        [f"Of {len(rows)} claims: {summary}.\n", table(worst), fold(f"All {len(rows)} claims", table(rows))]
    )


def statements(package: str) -> str:
    """A Markdown table of the sentences of a package's documentation that were tested by scripts, with verdicts."""
    rows = [
        {
            "said": f"[“{plain(r.said)}”]({r.link})" if pd.notna(r.link) else plain(r.said),
            "in": plain(r.where),
            "shown": plain(r.shows if pd.notna(r.shows) else r.reason),
            "verdict": plain(r.verdict),
            "remedy": plain(r.mend),
        }
        for r in _rows("audit_statements", package).itertuples()
    ]
    return table(rows) or "None was tested.\n"


def _integrators(peers) -> str:
    rows = [
        {
            "integrator": code(p.id),
            "name": plain(p.name),
            "order": p.order if p.order is not None else "",
            "step": "adaptive" if p.adaptive else "fixed",
            "problems": plain(p.scope),
            "source": plain(p.source),
        }
        for p in peers
    ]
    return table(rows)
