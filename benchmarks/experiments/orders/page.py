"""Measured orders: every method on every problem, against the order it declares."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.trade import sweep
from phasebench.benchmarks.page.markdown import listed, number, table
from phasebench.benchmarks.page.page import Page

GATE = 0.1


def _text(r) -> str:
    if r["points"] < 3:
        return "below the noise"
    half = (r["high"] - r["low"]) / 2
    return f"{r['order']:.2f} +- {half:.2f}" if half < 10 else f"{r['order']:.2f} (no window)"


def _write(data, figures):
    rows = data("rows")
    if rows is None:
        return None
    records = rows.astype(object).where(rows.notna(), None).to_dict("records")
    found = pd.DataFrame(sweep.orders(records))
    if found.empty:
        return ["No order scene was measured."], _errors(rows)
    found["text"] = found.apply(_text, axis=1)
    peers, found = found[found["kind"] != sweep.KIND], found[found["kind"] == sweep.KIND]
    if found.empty:
        return ["No method was measured on an order scene."], _errors(rows)
    seen = found[found["points"] >= 3]
    good = (seen["order"] - seen["declared"]).abs() < GATE
    irregular = seen[~good & ((seen["high"] - seen["low"]) / 2 > GATE)]
    sharp = seen[~good & ((seen["high"] - seen["low"]) / 2 <= GATE)]
    verdict = []
    exact = data("multiprecision")
    body = []
    if exact is not None:
        off = exact[(exact["order"] - exact["declared"]).abs() >= GATE]
        verdict.append(
            f"In {int(exact['digits'].min())}-digit arithmetic, without round-off, {len(exact) - len(off)} of {len(exact)} "
            f"(method, problem) pairs have |order - declared| < {GATE}"
            + (
                f"; not so {listed([f'{a} on {b}' for a, b in zip(off['method'], off['problem'], strict=True)])}."
                if len(off)
                else "."
            )
        )
        body += [
            "## Without round-off (mpmath)\n",
            _matrix(exact.assign(text=exact["order"].map(lambda x: f"{x:.3f}"))),
        ]
    verdict.append(
        f"In doubles, of {len(found)} pairs {len(seen)} have a window of at least three steps above the noise; {good.sum()} "
        f"of these are within {GATE} of the declared order, {len(irregular)} converge irregularly (interval wider than "
        f"{GATE}) and {len(sharp)} are not asymptotic on this ladder."
    )
    body += [
        "## In doubles, on the order scenes\n",
        "Order of the global error with the half-width of its 95 % interval, over the window that is fitted best (at least "
        "three steps; errors under 100 times the reference's uncertainty are noise and left out).\n",
        _matrix(found),
    ]
    if len(peers):
        body += ["Of the established integrators of fixed step, beside the order that is measured or claimed:\n"]
        body += [_matrix(peers.assign(declared=peers["declared"].fillna("")))]
    if len(irregular):
        body.append(
            "Irregular: "
            + listed([f"{r.method} on {r.problem}" for r in irregular.itertuples()], 40)
            + ". Schemes IV and V and their compositions are such where the orbit passes a zero of a(y): there the root "
            "leaves 1/2 on a few steps, whatever h (see the page on energy).\n"
        )
    if len(sharp):
        body.append(
            "Not asymptotic yet on the ladder: "
            + listed([f"{r.method} on {r.problem} ({r.order:.2f})" for r in sharp.itertuples()], 40)
            + ".\n"
        )
    body.append(_errors(rows))
    return verdict, "\n".join(body)


def _matrix(found: pd.DataFrame) -> str:
    wide = found.pivot_table(
        index=["method", "declared"], columns="problem", values="text", aggfunc="first", sort=False
    )
    return table(wide.reset_index().fillna(""))


def _errors(rows: pd.DataFrame) -> str:
    part = rows[(rows["purpose"] == sweep.ORDER)]
    out = ["## Errors on the order scenes\n"]
    if "global_error" not in part:
        return ""
    for scene, members in part.groupby("scene", sort=False):
        ran = members[members["status"] != "skipped"]
        left = members[members["status"] == "skipped"]
        uncertainty = ran["reference_uncertainty"].max()
        out += [
            f"### {scene}\n",
            f"t = {number(members['t_end'].iloc[0])}; uncertainty of the reference {number(uncertainty)}.\n",
            table(
                ran,
                {
                    "method": "method",
                    "h": "h",
                    **({"tol": "tolerance"} if "tol" in ran and ran["tol"].notna().any() else {}),
                    "global_error": "global error",
                    "refinement_difference": "refinement difference",
                    "energy_max": "energy error",
                    "gradient": "gradients",
                    "fallbacks": "fallbacks",
                    "seconds": "seconds",
                    "status": "status",
                },
            ),
        ]
        if len(left):
            reasons = left.groupby("reason")["method"].unique()
            out += [f"Skipped: {'; '.join(f'{listed(list(m), 40)} ({r})' for r, m in reasons.items())}.\n"]
    return "\n".join(out)


PAGE = Page(
    "orders",
    "Errors and orders",
    "how the error falls with h, for every method and problem",
    ("rows", "multiprecision"),
    _write,
)
