"""Generate a page for each method: formula, order, structure, stability, coefficients, packages, citation.

A page also lists the cases of the trade (the experiment that compares costs at equal error) that the method wins.
"""

from __future__ import annotations

import importlib
from collections import defaultdict
from functools import cache
from itertools import zip_longest

import mpmath
import pandas as pd
from pages import (
    Files,
    bibtex,
    cell,
    citations,
    code,
    facts,
    fenced,
    fold,
    paragraphs,
    plain,
    rst,
    stored,
    table,
    toctree,
)

from phasebench.benchmarks.ladder.choice import choices, winner
from phasebench.benchmarks.page.markdown import number
from phasebench.integrators import coefficients
from phasebench.integrators.coefficients.tableaus import runge_kutta
from phasebench.integrators.record import Method
from phasebench.integrators.records import compositions
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS, Peer

#: Digits of a coefficient on a page.
DIGITS = 40
#: Rows from which a table of coefficients is folded.
LONG = 12
#: Decimals to which ends of stability intervals are compared.
SAME = 5
ROUNDED = {True: "yes", False: "no"}


def files() -> Files:
    """The pages of the methods, of their families, and the index: file name -> Markdown."""
    pages = {f"methods/{m.id}.md": page(m) for m in METHODS}
    families = sorted({m.family for m in METHODS})
    pages |= {f"methods/families/{dashed(f)}.md": family_page(f) for f in families}
    rows = [
        {
            "method": f"[{m.id}]({m.id}.md)",
            "order": m.order,
            "family": f"[{dashed(m.family)}](families/{dashed(m.family)}.md)",
            "symplectic": m.symplectic,
            "symmetric": m.symmetric,
            "energy": m.energy,
            "requires": ", ".join(m.requires),
            "stable to": limit(m),
            "wins": sum(w["method"] == m.id for w in wins()),
        }
        for m in METHODS
    ]
    intro = (
        f"# Methods\n\nAll {len(METHODS)} methods of the suite, with what each declares; "
        "[the matrix](../reports/matrix.md) measures each declaration on every problem. "
        "*Stable to* is the largest h ω on the harmonic oscillator below which every step is stable; *wins* counts the "
        "cases (a scene, an error) of [the trade](../reports/trade.md) in which the method is the fastest of all.\n\n"
    )
    names = [*(f"families/{dashed(f)}" for f in families), *(m.id for m in METHODS)]
    pages["methods/index.md"] = intro + table(rows) + "\n" + toctree(names)
    return pages


def dashed(name: str) -> str:
    """A module's name as it stands in the address of a page, with dashes for underscores."""
    return name.replace("_", "-")


def page(m: Method) -> str:
    """The page of a method, as Markdown."""
    parts = [f"# {m.id}\n", plain(m.name[0].upper() + m.name[1:]) + ".\n", summary(m)]
    parts += ["## Formula\n", formula(m.family)]
    table_of = table_behind(m)
    numbers = listed_coefficients(m)
    if numbers:
        parts += ["## Coefficients\n", numbers, _origin(table_of) if table_of else ""]
    parts += ["## Where it wins\n", _wins(m), "## Audited packages that ship it\n", _packages(m)]
    parts += [
        "## Run it\n",
        fenced(f"phasebench stability {m.id}\nphasebench list methods --json\nphasebench cite {m.id}"),
    ]
    parts += ["## How to cite it\n", plain(m.source) + ".\n", bibtex(m.cite)]
    return "\n".join(parts)


def summary(m: Method) -> str:
    """A Markdown table of what a method declares (order, symplectic, ...) and of the measured stable steps."""
    return facts(
        {
            "Order": str(m.order),
            "Symplectic": ROUNDED[m.symplectic],
            "Symmetric": ROUNDED[m.symmetric],
            "Energy": plain(m.energy),
            "Invariants q·D p": plain(m.quadratic),
            "Requires": ", ".join(m.requires) or "nothing of the system",
            "Parameters": ", ".join(code(f"{k}={v}") for k, v in m.parameters.items()),
            "Stable for h ω in": _stability(m),
            "Family": f"[{dashed(m.family)}](families/{dashed(m.family)}.md)",
            "Source": citations(m.cite),
        }
    )


@cache
def _linear() -> dict[str, pd.Series]:
    """The measured stability on the harmonic oscillator: label of a method -> its row of the stored table."""
    return {row["label"]: row for _, row in stored("extremes_linear").iterrows()}


def _intervals(text: object) -> list[tuple[float, float]]:
    """The intervals (low, high) of h omega in a stored text such as ``0..2 3.1..4``; a missing end is infinite."""
    parts = [part.partition("..") for part in ("" if pd.isna(text) else str(text)).split()]
    return [(float(low), float(high) if high else float("inf")) for low, _, high in parts]


def _stability(m: Method) -> str:
    row = _linear().get(m.label)
    if row is None:
        return ""
    spans = _intervals(row["intervals"])
    if not spans:
        return f"nowhere ({row['how']})" if row["how"] != "not on the oscillator" else "not defined on the oscillator"
    text = ", ".join(f"[{low:.7g}, {'∞' if high == float('inf') else f'{high:.7g}'})" for low, high in spans[:6])
    return f"{text}{' and more' if len(spans) > 6 else ''} ({row['how']})"


def limit(m: Method) -> str:
    """The end of a method's interval of stable h omega that begins at 0, as text; "" if it was not measured."""
    row = _linear().get(m.label)
    if row is None or pd.isna(row["limit"]):
        return ""
    return "∞" if row["limit"] == float("inf") else f"{row['limit']:.4g}"


def _docstring(family: str) -> str:
    return importlib.import_module(f"phasebench.integrators.families.{family}").__doc__ or ""


def formula(family: str) -> str:
    """The first formula of a family's docstring with the text around it, or its first paragraph if it has no formula.

    ``family`` is the name of the module of a family of methods.  A link to the family's page follows.
    """
    parts = paragraphs(_docstring(family))
    at = next((i for i, part in enumerate(parts) if ".. math::" in part), None)
    end = None if at is None else at + 2
    while end is not None and any(".. math::" in part for part in parts[end : end + 1]):
        end += 1
    chosen = parts[:1] if at is None else parts[max(at - 1, 1) : end]
    chosen = [part for part in chosen if not part.startswith(("Source", "Reference"))]
    return rst("\n\n".join(chosen)) + f"\nAll of it: [{dashed(family)}](families/{dashed(family)}.md).\n"


def family_page(family: str) -> str:
    """The page of a family of methods as Markdown: the docstring of its module, and a table of its methods."""
    parts = paragraphs(_docstring(family))
    members = [m for m in METHODS if m.family == family]
    rows = [
        {"method": f"[{m.id}](../{m.id}.md)", "order": m.order, "symplectic": m.symplectic, "energy": m.energy}
        for m in members
    ]
    return f"# {dashed(family)}\n\n{rst(chr(10).join(f'{p}{chr(10)}' for p in parts))}\n## Its methods\n\n{table(rows)}"


def digits(x: object) -> str:
    """A coefficient as code for a table: an exact number or text as it is, a multiprecision one to `DIGITS` digits."""
    if isinstance(x, mpmath.mpf):
        with mpmath.workdps(DIGITS + 10):
            return code(mpmath.nstr(x, DIGITS))
    return x if x in ("drift", "kick") else code(str(x))


def columns(heads: str, *values) -> str:
    """A Markdown table of coefficients with the row number k before them, folded if it has more than `LONG` rows.

    ``heads`` are the names of the columns, separated by spaces; ``values`` the columns, of which shorter ones end in
    empty cells.
    """
    names = heads.split()
    rows = [
        {"k": k} | {name: digits(x) if x is not None else "" for name, x in zip(names, row, strict=True)}
        for k, row in enumerate(zip_longest(*values), 1)
    ]
    text = table(rows)
    return fold(f"{len(rows)} rows", text) if len(rows) > LONG else text


def listed_coefficients(m: Method) -> str:
    """A Markdown table of the coefficients of a method; "" if it has none."""
    of = table_behind(m)
    if of is not None and of.gamma:
        return "Fractions of the step over which the symmetric method is composed:\n\n" + columns(
            "γ_k", coefficients.steps(of.name)
        )
    if of is not None:
        names = {"A": "drift", "B": "kick"}
        letters, numbers = zip(*coefficients.steps(of.name), strict=True)
        return columns("substep fraction", [names[x] for x in letters], numbers)
    if m.family == "parametric":
        return columns("c_k μ_k λ_k", *zip(*m.data[1], strict=True))
    if m.family == "schemes_iv_v":
        return columns("c_k sign", *list(zip(*m.data, strict=True))[:2])
    if m.family == "runge_kutta":
        *A, b = m.data
        rows = [{"i": str(i)} | {f"j={j}": digits(x) for j, x in enumerate(row, 1)} for i, row in enumerate(A, 1)]
        weights = {"i": "b"} | {f"j={j}": digits(x) for j, x in enumerate(b, 1)}
        return fold(f"A (i, j) and b, {len(b)} stages", table([*rows, weights])) if rows else ""
    if m.family == "collocation" and m.data[0] in ("gauss", "radau-iia", "lobatto-iiia-iiib"):
        with mpmath.workdps(DIGITS + 10):
            _, _, b, c = runge_kutta(*m.data[:2])
            return columns("c_k b_k", list(c), list(b))
    if m.family == "wisdom_holman":
        return columns("a_k b_k", *m.data[:2])
    if m.family == "force_gradient":
        return columns("a_k b_k c_k", *zip(*m.data[0], strict=True))
    return ""


def table_behind(m: Method):
    """The table of a splitting or composition, or that by which a method is composed of a simpler one; else None.

    The composition is told by the end of the method's id, such as "-yoshida-4".
    """
    if m.family in ("processed", "force_gradient"):
        return None
    suffix = next((name for name in compositions.COMPOSITIONS if m.id.endswith(f"-{name}")), None)
    return coefficients.BY_NAME.get(m.id) or coefficients.BY_NAME.get(suffix)


def _origin(of) -> str:
    """A Markdown table of where a method's coefficients were published, and how well they meet the order conditions.

    ``of`` is their record; "" if the coefficients were not measured.
    """
    frame = stored("coefficients")
    found = frame[frame["table"] == of.name]
    if found.empty:
        return ""
    row = found.iloc[0]
    lines = facts(
        {
            "Published in": plain(of.source),
            "Order conditions": str(row["conditions"]),
            "Residual as published": number(row["published residual"]),
            "Residual polished": number(row["polished residual"]),
            "Largest change of a number": number(row["moved by"]),
            "Sum of sizes": number(row["sum of sizes"]),
            "Error constant": cell(row["error constant"]),
        }
    )
    return f"Polished to 60 digits on the order conditions ([all tables](../reports/coefficients.md)):\n\n{lines}"


@cache
def wins() -> list[dict]:
    """The cases (scene, quantity, error) of the trade, a dict for each with the fastest integrator as ``method``.

    The trade is the experiment that compares costs at equal error.  A dict also has the step or tolerance, and the time
    of our best method over that of the best peer (an integrator of another package).
    """
    found = choices(stored("front"))
    return [
        {
            "method": str(winner(row)).partition("(")[0],
            "scene": f"[{row['scene']}](../reports/trade-{row['scene']}.md)",
            "quantity": row["quantity"],
            "error": row["accuracy"],
            "h or tol": row["ours h"] if winner(row) == row["ours integrator"] else row["peer tol"],
            "beside the best peer": row["ratio"],
        }
        for row in found.to_dict("records")
    ]


def _wins(m: Method) -> str:
    """Markdown on the cases in which a method is the fastest: a table by scene, or why it is in none.

    A case is a scene (problem, span and quantity) and an error of the trade, the experiment that compares costs.
    """
    by_scene: dict[str, list[dict]] = defaultdict(list)
    for win in wins():
        if win["method"] == m.id:
            by_scene[win["scene"]].append(win)
    if not by_scene:
        dropped = stored("front_dropped")
        why = dropped[dropped["integrator"] == m.id]
        return _dropped(why) if len(why) else "It does not compete in [the trade](../reports/trade.md).\n"
    rows = [
        {
            "scene": scene,
            "quantity": found[0]["quantity"],
            "at errors": ", ".join(f"{w['error']:g}" for w in found),
            "h": ", ".join(number(w["h or tol"], 3) for w in found),
            "time beside the best peer's": ", ".join(number(w["beside the best peer"], 2) or "alone" for w in found),
        }
        for scene, found in by_scene.items()
    ]
    return "The fastest of all in [the trade](../reports/trade.md):\n\n" + table(rows)


def _dropped(why: pd.DataFrame) -> str:
    rows = [
        {"scene": f"[{r.scene}](../reports/trade-{r.scene}.md)", "not the fastest because": plain(r.why)}
        for r in why.itertuples()
    ]
    return "In no case of [the trade](../reports/trade.md) the fastest:\n\n" + fold(f"{len(rows)} scenes", table(rows))


@cache
def shipped() -> dict[str, list[Peer]]:
    """Return a dict: id of a method -> the audited peers (integrators of other packages) that behave like it.

    Such a peer has the method's order, is symplectic if and only if the method is, and is stable on the harmonic
    oscillator in the same intervals of h omega, as far as both were scanned.  The first interval must end within the
    scan and not at 0.
    """
    audit = stored("audit")
    measured = audit[(audit["measure"] == "stability") & audit["intervals"].notna()].set_index("peer")
    found: dict[str, list[Peer]] = defaultdict(list)
    for peer in (p for p in PEERS if p.id in measured.index):
        row = measured.loc[peer.id]
        for m in METHODS:
            mine = _linear().get(m.label)
            same = m.order == peer.order and m.symplectic == bool(peer.claims.symplectic)
            if same and mine is not None and _equal(mine, row):
                found[m.id].append(peer)
    return found


def _equal(mine: pd.Series, other: pd.Series) -> bool:
    until = min(float(mine["scanned"] or 0), float(other["scanned"] or 0)) or 0.0
    a, b = (_cut(_intervals(row["intervals"]), until) for row in (mine, other))
    return bool(a) and a == b and 0 < a[0][1] < until


def _cut(spans: list[tuple[float, float]], until: float) -> list[tuple[float, float]]:
    return [(round(low, SAME), round(min(high, until), SAME)) for low, high in spans if low < until]


def _packages(m: Method) -> str:
    found = shipped().get(m.id, [])
    if not found:
        return "No audited integrator has its order, symplecticity and stability intervals.\n"
    rows = [
        {"package": f"[{p.package}](../packages/{p.package}.md)", "integrator": code(p.id), "name": plain(p.name)}
        for p in found
    ]
    how = "Audited integrators of the same order, symplecticity and measured stability intervals on the oscillator "
    return f"{how}(methods that differ elsewhere only are not told apart by these):\n\n{table(rows)}"
