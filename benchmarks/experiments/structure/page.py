"""Symplecticity and symmetry of the step maps, measured without round-off."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.multiprecision import DIGITS
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

#: A defect of at most this is the solver's and the differences' own error in 40 digits.
NOTHING = 1e-22
#: Defects are drawn no smaller.
FLOOR = 1e-42
PROPERTIES = ("symplecticity", "symmetry")


def _judge(structure: pd.DataFrame, name: str) -> Verdict | None:
    part = structure[structure["property"] == name]
    if part.empty:
        return None
    having, lacking = part[part["declared"]], part[~part["declared"]]
    broken, hidden = having[having["defect"] > NOTHING], lacking[lacking["defect"] <= NOTHING]
    text = f"{name.capitalize()}: "
    if len(having):
        text += f"of {len(having)} methods declared to have it the largest defect is {number(having['defect'].max())}"
    if len(lacking):
        text += (
            f"{'; ' if len(having) else ''}of the {len(lacking)} others the least is {number(lacking['defect'].min())}"
        )
    if len(broken):
        text += f"; it is broken by {listed(list(broken['method']), 4)}"
    if len(hidden):
        text += f"; undeclared, it is had by {listed(list(hidden['method']), 4)}"
    wrong = len(broken) + len(hidden)
    short = f"{len(part) - wrong} of {len(part)} step maps are as declared in {name}."
    return Verdict(f"{text}.", not wrong, short)


@of("structure")
def symplecticity(structure: pd.DataFrame) -> Verdict | None:
    """Whether the methods declared symplectic are, and the others are not."""
    return _judge(structure, "symplecticity")


@of("structure")
def symmetry(structure: pd.DataFrame) -> Verdict | None:
    """Whether the methods declared symmetric are, and the others are not."""
    return _judge(structure, "symmetry")


@of("structure")
def draw(structure: pd.DataFrame, folder) -> list[Picture]:
    """Every defect, sorted, the declared ones apart."""
    with style.settings():
        figure, (panels,) = style.panels(1, 2, 3.0, sharey=True)
        for axes, name in zip(panels, PROPERTIES, strict=True):
            part = structure[structure["property"] == name]
            first = 0
            for k, (declared, label) in enumerate(((True, "declared"), (False, "not declared"))):
                defect = np.sort(part[part["declared"] == declared]["defect"].clip(lower=FLOOR))
                look = {"color": style.CURVES[k][0], "marker": style.CURVES[k][2], "linestyle": "none"}
                axes.semilogy(first + np.arange(len(defect)), defect, label=label, **look)
                first += len(defect)
            axes.axhline(NOTHING, color=style.GREY, linewidth=0.9, linestyle="--")
            axes.set(title=name, xlabel="methods, by defect")
            axes.grid(axis="y", color="0.93", linewidth=0.5)
        panels[0].set_ylabel("defect of one step")
        style.legend_above(figure, panels[0], 2)
    caption = (
        f"Defects of the step maps in {DIGITS} digits, the largest over the systems; dashed: {NOTHING:g}, below which a defect "
        f"is the solver's own; zeros are drawn at {FLOOR:g}."
    )
    return [Picture(style.save(figure, folder, "structure.png"), "defects of the step maps", caption)]


@of("structure")
def table(structure: pd.DataFrame) -> Table:
    """The methods nearest to the line between having and lacking."""
    columns = ["property", "method", "declared", "defect"]
    parts = []
    for name in PROPERTIES:
        part = structure[structure["property"] == name]
        parts += [part[part["declared"]].nlargest(6, "defect"), part[~part["declared"]].nsmallest(6, "defect")]
    shown = pd.concat(parts)[columns].head(ROWS)
    shown["declared"] = shown["declared"].map({True: "yes", False: "no"})
    caption = (
        "Nearest to the line: of each property the six largest defects declared none, and the six least declared some."
    )
    return Table(shown, caption)


@of("structure")
def _whole(structure: pd.DataFrame) -> pd.DataFrame:
    return structure.assign(declared=structure["declared"].map({True: "yes", False: "no"}))


PAGE = Page(
    id="structure",
    question="Are the step maps symplectic and symmetric where they are declared to be?",
    tables=("structure",),
    setting=(
        "Symplecticity: the largest entry of MᵀJM − J, M the Jacobian of one step by differences.",
        "Symmetry: |Φ₋ₕ(Φₕ(y)) − y|, the distance from the start after a step and the same step backwards.",
        "Systems: pendulum, Hénon–Heiles, and non-separable ones where the method can do them; the largest counts.",
        f"In {DIGITS}-digit arithmetic (MPFR through gmpy2), with stages solved to it: a defect of round-off does not hide a small one.",
    ),
    verdicts=(symplecticity, symmetry),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"The line is drawn at {NOTHING:g}; a method whose defect is smaller on all systems would pass unseen.",
        "Schemes IV and V choose λ from the state, so their maps are not symplectic; at a frozen λ they are.",
    ),
    command="pytest benchmarks/experiments/orders",
)
