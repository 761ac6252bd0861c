"""The talk's printed tables beside the measured ones, and the riddle of Scheme IV."""

from __future__ import annotations

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.page.markdown import number, table
from phasebench.benchmarks.page.page import Page

from .printed import AGREEMENT, RIDDLE


def _write(data, figures):
    frame = data("printed")
    if frame is None:
        return None
    riddle = frame["scheme"] == RIDDLE[0]
    rest, iv = frame[~riddle], frame[riddle]
    agree = rest["units"] <= AGREEMENT
    worst = rest.loc[rest["units"].idxmax()]
    verdict = [
        f"{agree.sum()} of {len(rest)} printed entries of Schemes I-III, AVF and V are reproduced within {AGREEMENT} of the "
        f"last printed digit; the farthest is {worst['scheme']} {worst['lambda'] if isinstance(worst['lambda'], str) else ''} "
        f"at h = {number(worst['h'])}: printed {worst['printed']:.2E}, measured {worst['refinement_difference']:.5E} "
        f"({worst['units']:.2f} units)."
    ]
    body = [
        'The talk\'s tables "Convergence rates with chaotic orbits at t = 1" (Henon-Heiles) print the difference in the '
        "maximum norm over (p, q) between the solutions with h and 2h. `refinement difference` is that number; "
        "`global error` is the error against a certified Taylor solution (its uncertainty is in the last column).\n"
    ]
    columns = {
        "scheme": "scheme",
        "lambda": "lambda",
        "h": "h",
        "printed": "printed",
        "refinement_difference": "refinement difference",
        "order": "order",
        "units": "off by, last digits",
        "global_error": "global error",
        "uncertainty": "uncertainty",
    }
    scientific = {"printed": 2, "refinement_difference": 4, "global_error": 2, "uncertainty": 0}
    shown = frame.assign(
        **{"lambda": frame["lambda"].fillna("")},
        **{c: frame[c].map(lambda x, n=n: f"{x:.{n}E}") for c, n in scientific.items()},
        **{c: frame[c].map(lambda x: "" if x != x else f"{x:.2f}") for c in ("order", "units")},
    )
    body.append(table(shown, columns, digits=4))
    if len(iv):
        verdict.append(_riddle(data, iv, body))
    return verdict, "\n".join(body)


def _riddle(data, iv, body) -> str:
    slope = metrics.power(iv["h"], iv["refinement_difference"]).value
    printed = metrics.power(iv["h"], iv["printed"].astype(float)).value
    sentence = (
        f"Scheme IV is not reproduced: on the root nearest 1/2 it has order {slope:.2f} (the talk's theorem asks for 2), "
        f"the printed column has order {printed:.2f}."
    )
    scan, columns, roots = data("riddle"), data("riddle_columns"), data("riddle_roots")
    body.append("\n## The riddle of Scheme IV\n")
    if scan is not None:
        everywhere = (scan["without a root"] == 0).all()
        sentence += (
            f" An exhaustive scan of all {scan['steps'].sum()} steps finds a root near 1/2 "
            f"({number(scan['nearest root, least'].min(), 4)} to {number(scan['nearest root, greatest'].max(), 4)}) on "
            f"{'every one' if everywhere else 'not every one'}, and {scan['far roots'].sum()} far roots, none closer than "
            f"{number((scan['far root closest to 1/2'] - 0.5).abs().min())} to 1/2."
        )
        body += [
            "Every root of E(lambda, h) = 0 on the principal branch of the stage equations, on every step of the consistent "
            "trajectory; the branch ends where the stage equations lose their solution (`scanned from`, `scanned to`: the "
            "range covered on every step).\n",
            table(scan, digits=4),
        ]
    if roots is not None and len(roots):
        times = roots.groupby("h")["t"].agg(["min", "max", "count"]).reset_index()
        times.columns = ["h", "first far root at t", "last far root at t", "far roots"]
        body += ["Where the far roots are:\n", table(times)]
    if columns is not None:
        constant = columns[columns["recipe"].str.startswith("Scheme I,")]
        steps = [c for c in columns.columns if c not in ("recipe", "entries that agree")]
        best = constant["entries that agree"].max()
        sentence += f" No constant parameter tried gives more than {best} of its {len(steps)} entries."
        unit = [f"{h}: {abs(float(columns[h][0]) / _per_unit(constant, h)):.3f}" for h in steps]
        body += [
            "The printed column beside the consistent root and constant parameters (refinement differences):\n",
            table(columns, digits=4),
            "A constant parameter's difference grows in proportion to its distance from 1/2. By that proportion the printed "
            f"entries ask for a mean distance of {'; '.join(f'h = {u}' for u in unit)}, far from what the consistent root "
            "takes on any step of this orbit.\n",
        ]
    return sentence


def _per_unit(constant, h) -> float:
    """The refinement difference per unit of |lambda - 1/2|, from lambda = 0 and 1."""
    ends = constant[constant["recipe"].isin(["Scheme I, lambda = 0", "Scheme I, lambda = 1"])]
    return float(ends[h].mean() / 0.5)


PAGE = Page(
    "printed-tables",
    "The talk's tables",
    "every printed entry beside the measured one, and the column that does not reproduce",
    ("printed", "riddle", "riddle_columns", "riddle_roots"),
    _write,
)
