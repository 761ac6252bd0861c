"""Cold and warm starts beside what is wanted of them."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, Verdict, of

from . import start

#: Seconds that a first integration, and a warm command, may take.
COLD_WANTED, WARM_WANTED = 5.0, 0.6


@of(start.COLD)
def first(cold: pd.DataFrame) -> Verdict:
    """Whether every first integration is as short as is wanted."""
    late = cold[~(cold["seconds"] <= COLD_WANTED) | (cold["status"] != "ok")].sort_values("seconds", ascending=False)
    longest = cold.loc[cold["seconds"].idxmax()]
    counts = f"{len(cold) - len(late)} of {len(cold)} first integrations arrive within {COLD_WANTED:g} s"
    names = [f"{r['method']} on {r['problem']} ({_how(r)})" for _, r in late.iterrows()]
    more = f"not so: {listed(names, 4)}" if names else f"the longest is {_named(longest)}"
    middle = f"the median is {cold['seconds'].median():.1f} s"
    return Verdict(f"{counts} of the processor's time; {middle}, {more}.", late.empty, f"{counts}.")


def _how(row: pd.Series) -> str:
    return f"{row['seconds']:.1f} s" if row["status"] == "ok" else str(row["status"])


def _named(row: pd.Series) -> str:
    return f"{row['method']} on {row['problem']} with {row['seconds']:.1f} s"


@of(start.WARM)
def again(warm: pd.DataFrame) -> Verdict | None:
    """Whether a command that finds everything compiled is as short as is wanted; how much of it is Numba's import."""
    floor, commands = warm[warm["what"] == start.FLOOR], warm[warm["what"] != start.FLOOR]
    if commands.empty:
        return None
    over = commands[~(commands["seconds"] <= WARM_WANTED)]
    longest = commands.loc[commands["seconds"].idxmax()]
    counts = f"{len(commands) - len(over)} of {len(commands)} warm commands end within {WARM_WANTED:g} s"
    text = f"{counts} by the clock; the longest, `{longest['what']}`, takes {longest['seconds']:.2f} s"
    if len(floor):
        text += f", of which the import of Numba is {floor['seconds'].iloc[0]:.2f} s"
    return Verdict(f"{text}.", over.empty, f"{counts}.")


@of(start.COLD)
def draw(cold: pd.DataFrame, folder) -> list[Picture]:
    """The cold starts."""
    cold = cold.sort_values("seconds", ascending=False)
    y = np.arange(len(cold))
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 1.0 + 0.2 * len(cold))
        axes.barh(y, cold["seconds"], height=0.6, color=style.BLUE)
        axes.axvline(COLD_WANTED, color=style.VERMILION, linewidth=1.2)
        axes.set_yticks(y, [f"{r['method']}, d = {r['d']}" for _, r in cold.iterrows()])
        axes.set_ylim(len(cold) - 0.5, -0.5)
        axes.set_xlabel("seconds of the processor in the first integration")
        axes.set_axisbelow(True)
        axes.grid(axis="x", color="0.93", linewidth=0.5)
    caption = f"First integrations with an empty cache; the line: at most so much is wanted, {COLD_WANTED:g} s."
    return [Picture(style.save(figure, folder, "start.png"), "first integrations", caption)]


def table(data: Data) -> Table | None:
    """Cold starts, the longest first, then the warm ones."""
    cold, warm = data(start.COLD), data(start.WARM)
    parts = []
    if warm is not None and len(warm):
        part = pd.DataFrame({"start": "warm", "what": warm["what"], "d": "", "seconds": warm["seconds"]})
        part["interval"] = [f"{low:.2f} to {high:.2f}" for low, high in zip(warm["low"], warm["high"], strict=True)]
        parts.append(part)
    if cold is not None and len(cold):
        longest = cold.sort_values("seconds", ascending=False).head(ROWS - sum(map(len, parts)))
        part = pd.DataFrame({"start": "cold", "what": longest["method"] + " on " + longest["problem"]})
        part[["d", "seconds"]] = longest[["d", "seconds"]].astype({"d": object})
        parts.insert(0, part)
    if not parts:
        return None
    caption = (
        "Cold: of the processor, once. Warm: by the clock, a whole process, the median of rounds with its interval."
    )
    return Table(pd.concat(parts, ignore_index=True).head(ROWS).fillna(""), caption)


@of(start.COLD)
def _whole(cold: pd.DataFrame) -> pd.DataFrame:
    return cold


PAGE = Page(
    id="start",
    question="How long until the first result?",
    tables=(start.COLD, start.WARM),
    setting=(
        f"A run of {start.STEPS} steps: what is told is the time to make it ready.",
        "Cold: a fresh process with an empty cache, from `integrate` on, after imports and the making of the problem; a "
        "method of each kernel, at d = 4 where it can, and the longest on systems of other kinds.",
        f"Warm: whole processes of `phasebench integrate` with a filled cache, {start.ROUNDS} rounds in turns with a "
        "process that imports Numba and does nothing.",
    ),
    verdicts=(first, again),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Wanted are at most {COLD_WANTED:g} s cold and {WARM_WANTED:g} s warm; both are the machine's own, and a busy "
        "machine lengthens them, what is by the clock more so.",
        "Other methods of a kernel share its compiled code: a second method of it, or a second problem of the same d, "
        "starts faster than what is shown.",
        "At other d a kernel is compiled anew up to d = 20, and takes longer the larger d is.",
    ),
    command="pytest benchmarks/experiments/start",
)
