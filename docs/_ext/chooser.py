"""The data of the page "Which integrator should I use?", found among the stored runs.

A reader chooses a class of problem, a short or long span, an error, and what must be kept (nothing, the symplectic form
or the energy); the answer is the cheapest run.  Runs are those of the trade, the experiment that compares costs at
equal error (the best few integrators, its finalists, are timed in turns), and those of energy-preserving methods from
the experiment on options.  Of several scenes (problems with a span and a quantity) that match, the integrator with the
smallest geometric mean of its time over the cheapest's is named, with its step on the first scene on which it meets the
error.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cache
from math import exp, log

import pandas as pd
from pages import Files, code, stored, table

from phasebench.benchmarks.advice.prior import LARGEST
from phasebench.benchmarks.measure import conservation_claims as claims
from phasebench.benchmarks.measure.integrator import OURS, Integrator
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.problems import problem
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers import BY_ID as PEERS

#: Class of problem -> (what it is, for a person; the condition on its system), the first that holds counts.
CLASSES = {
    "constrained": ("bound by constraints g(q) = 0", lambda s: s.constrained),
    "poisson": ("Poisson system (not canonical)", lambda s: not s.canonical),
    "bodies": ("many bodies (three or more)", lambda s: len(s.singular) >= BODIES),
    "non-separable": ("non-separable: H(q, p)", lambda s: not s.separable),
    "singular": ("singular: V grows without bound, as Kepler's", lambda s: len(s.singular) > 0),
    "oscillatory": ("oscillatory: a fast linear part", lambda s: fastest(s) > FAST),
    "separable": ("separable: T(p) + V(q)", lambda s: not s.traits["quadratic kinetic energy"]),
    "quadratic": ("quadratic kinetic energy: |p|²/2m + V(q), smooth", lambda s: True),
}
#: Distances between three bodies; a fast frequency, where the slow ones are 1; revolutions of a long span.
BODIES, FAST, LONG = 3, 10.0, 30.0
SPANS = {"short": f"up to {LONG:g} revolutions", "long": "longer"}
KEEPS = {"": "nothing in particular", "symplectic": "the symplectic form", "energy": "the energy, to round-off"}
#: Quantities that say how accurate the solution is.
STATES = ("end-state", "trajectory", "phase", "perihelion", "section", "jupiter-longitude", "azimuth", "drift-angle")
ACCURACIES = tuple(10.0**-k for k in range(1, 13))
#: The accuracies of the printed table.
PRINTED = (1e-3, 1e-6, 1e-9)
COLUMNS = ["scene", "problem", "quantity", "t_end", "accuracy", "integrator", "h", "tol", "steps", "error", "seconds"]


def fastest(system) -> float:
    """The largest declared frequency of a system's linear part; 0 if none is declared."""
    return max((float(w) for w in system.frequencies or ()), default=0.0)


@cache
def class_of(name: str) -> str:
    """The class (a key of `CLASSES`) of the problem with this name, such as "separable"."""
    system = problem(name).system
    return next(id for id, (_, holds) in CLASSES.items() if holds(system))


@cache
def span_of(name: str, t_end: float) -> str:
    """Return "long" if the problem makes more than `LONG` revolutions until ``t_end``, else "short"."""
    return "long" if t_end > 2 * LONG * problem(name).pace.span else "short"


def runs() -> pd.DataFrame:
    """Every stored run that may be named, a row each with the columns `COLUMNS`.

    ``accuracy`` is set in runs of finalists (the best few integrators, timed in turns at this error), and NaN in
    others.
    """
    front = stored("front")[["scene", "problem", "quantity", "t_end"]].drop_duplicates()
    trade = [stored("front_finals"), stored("front_rungs")]
    found = pd.concat([part[part["status"] == "ok"].merge(front, on="scene") for part in trade])
    kept = stored("knobs_ladders")
    kept = kept[(kept["knob"] == "energy") & (kept["status"] == "ok") & (kept["fallbacks"] == 0)].copy()
    kept["problem"], kept["integrator"], kept["quantity"] = kept["scene"], kept["method"], "end-state"
    kept["t_end"], kept["seconds"] = (kept["h"] * kept["steps"]).round(6), 1e-6 * kept["us"]
    kept["scene"] = ""
    found = pd.concat([found, kept])[COLUMNS]
    return found[found["quantity"].isin(STATES)]


@cache
def keeps(id: str, what: str) -> bool:
    """True if an integrator states that it keeps ``what``, a key of `KEEPS`: "" (nothing), "symplectic" or "energy".

    ``id`` is that of a method or of a peer (an integrator of another package).  For "energy" the statement of a peer
    does not count.
    """
    name = id.partition("(")[0]
    record = BY_ID.get(name) or PEERS.get(name)
    if not what or record is None:  # of a loop around a package's solver, which only competes here, nothing is stated
        return not what
    integrator = Integrator(record)
    return (what != "energy" or integrator.kind == OURS) and bool(claims.declaration(integrator, what))


def has_command(id: str) -> bool:
    """True if a command can run an integrator: a method of this suite, or a peer with the settings of its package."""
    return is_own(id) or id in PEERS


def cheapest(scene: pd.DataFrame, accuracy: float) -> pd.DataFrame:
    """The cheapest run of each integrator that meets ``accuracy`` on a scene, sorted by time.

    ``scene`` has the runs on one scene (a problem with a span and a quantity).  For an integrator that was a finalist
    at this accuracy, the time of the final counts.
    """
    finals = scene[(scene["accuracy"] / accuracy - 1).abs() < 1e-6]
    rungs = scene[scene["accuracy"].isna() & (scene["error"] <= accuracy)]
    rungs = rungs[~rungs["integrator"].isin(finals["integrator"])]
    both = pd.concat([finals, rungs]).sort_values("seconds", kind="stable")
    return both.drop_duplicates("integrator")


def choose(scenes: list[pd.DataFrame], accuracy: float, keep: str) -> dict | None:
    """Choose the integrator for scenes of a class at an accuracy; None if no stored run meets it and keeps ``keep``.

    ``scenes`` has a table of runs for each scene (a problem with a span and a quantity); ``keep`` is "", "symplectic"
    or "energy".  Returns a dict: the ``integrator``, ``own`` (True for a method of this suite), the entries of `_size`
    (its run: problem, step or tolerance, error, time, command) and those of `_beside` (the best rival and the ratio).
    """
    met = [cheapest(scene, accuracy) for scene in scenes]
    able = [part[[keeps(id, keep) and has_command(id) for id in part["integrator"]]] for part in met]
    able, met = [a for a in able if len(a)], [m for a, m in zip(able, met, strict=True) if len(a)]
    if not able:
        return None
    factors = [dict(zip(a["integrator"], a["seconds"] / a["seconds"].min(), strict=True)) for a in able]
    ids = sorted({id for f in factors for id in f})
    best = min(ids, key=lambda id: (_mean(min(f.get(id, LARGEST), LARGEST) for f in factors), id))
    at = next(k for k, f in enumerate(factors) if best in f)
    row, others = able[at].set_index("integrator").loc[best], met[at]
    own = is_own(best)
    rivals = others[[is_own(id) != own for id in others["integrator"]]]
    alike = rivals[[keeps(id, keep) for id in rivals["integrator"]]]
    rival = (alike if len(alike) else rivals).head(1)
    return {"integrator": best, "own": own, **_size(row), **_beside(row, rival, len(alike) > 0)}


def is_own(id: str) -> bool:
    """True if an integrator is a method of this suite, not of another package; ``id`` may end in (parameters)."""
    return id.partition("(")[0] in BY_ID


def _mean(values: Iterable[float]) -> float:
    values = list(values)
    return exp(sum(map(log, values)) / len(values))


def _size(row: pd.Series) -> dict:
    """Describe a run as a dict: its problem, scene (a problem with a span and a quantity), size, error and time.

    The ``size`` is its step or its tolerance, as text; ``command`` is the command line that makes the run again.
    """
    adaptive = pd.notna(row["tol"])
    size = f"--tol {row['tol']:g}" if adaptive else f"--steps {int(row['steps'])}"
    id, _, rest = str(row.name).partition("(")
    given = [f"--param {part.strip()}" for part in rest.rstrip(")").split(",") if is_own(id) and part]
    words = ["phasebench integrate", row["problem"], id, *given, size, f"--t-end {float(row['t_end'])!r}", "--error"]
    words += [] if row["quantity"] == "end-state" else [f"--quantity {row['quantity']}"]
    return {
        "problem": row["problem"],
        "scene": row["scene"],
        "t_end": row["t_end"],
        "quantity": row["quantity"],
        "size": f"tol = {row['tol']:g}" if adaptive else f"h = {number(row['t_end'] / row['steps'])}",
        "error": number(row["error"], 2),
        "time": f"{number(1e6 * row['seconds'])} µs",
        "command": " ".join(words),
    }


def _beside(row: pd.Series, rival: pd.DataFrame, alike: bool) -> dict:
    """Compare the time of a run with that of the best rival, an integrator of the other side.

    The sides are this suite's methods and other packages' integrators.  ``rival`` holds the rival's run, or no row;
    ``alike`` tells whether the rival keeps what the reader wants kept, such as the energy.  Returns a dict:
    the id of the rival, the ratio of the run's time to the rival's as text (both "" without a rival), and ``alike``.
    """
    if rival.empty:
        return {"rival": "", "ratio": "", "alike": False}
    best = rival.iloc[0]
    return {"rival": best["integrator"], "ratio": number(row["seconds"] / best["seconds"], 2), "alike": alike}


def answers() -> list[dict]:
    """The answers to all choices for which there is a run: a dict for each class, span, property kept and accuracy.

    A dict has these four, "class", "span", "keep" and "accuracy", and the entries of `choose`.
    """
    found = runs()
    found["class"] = found["problem"].map(class_of)
    found["span"] = [span_of(p, t) for p, t in zip(found["problem"], found["t_end"], strict=True)]
    rows = []
    for (kind, span), part in found.groupby(["class", "span"], sort=False):
        scenes = [scene for _, scene in part.groupby(["scene", "problem", "t_end"], sort=False)]
        for keep in KEEPS:
            for accuracy in ACCURACIES:
                answer = choose(scenes, accuracy, keep)
                if answer:
                    rows.append({"class": kind, "span": span, "keep": keep, "accuracy": f"{accuracy:g}", **answer})
    return rows


def select(id: str, label: str, options: dict[str, str]) -> str:
    """HTML of a field of the form, a drop-down list.

    ``id`` ends the id of the element, ``label`` stands before it, ``options`` maps its values to their texts.
    """
    inside = "".join(f'<option value="{value}">{text}</option>' for value, text in options.items())
    return f'<label>{label}<select id="choose-{id}">{inside}</select></label>'


def files() -> Files:
    """The generated files of the page, name -> text: the form with its data (HTML), and the same answers as tables."""
    found = answers()
    kinds = dict(reversed([(id, text) for id, (text, _) in CLASSES.items()]))
    fields = select("class", "Class of problem", kinds)
    fields += select("accuracy", "Error allowed", {f"{a:g}": f"{a:g}" for a in ACCURACIES})
    fields += select("span", "Span", SPANS) + select("keep", "Must be kept", KEEPS)
    data = json.dumps(found, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    form = f'<form id="chooser" hidden>{fields}</form>\n<div id="choice" aria-live="polite"></div>\n'
    form += f'<script type="application/json" id="choices">{data}</script>\n'
    return {"_generated/chooser.html": form, "_generated/chooser.md": printed(found, kinds)}


def printed(found: list[dict], kinds: dict[str, str]) -> str:
    """The answers as Markdown tables at the accuracies `PRINTED`, a table for each property kept.

    ``found`` are the `answers`, ``kinds`` maps each class of problem to its description.
    """
    parts = []
    for keep, what in KEEPS.items():
        rows = []
        for kind, text in kinds.items():
            for span in SPANS:
                mine = [a for a in found if (a["class"], a["span"], a["keep"]) == (kind, span, keep)]
                at = {a["accuracy"]: f"{code(a['integrator'])}, {a['size']} ({a['ratio'] or 'alone'})" for a in mine}
                if mine:
                    rows.append(
                        {"class": text.partition(":")[0], "span": span}
                        | {f"to {x:g}": at.get(f"{x:g}", "") for x in PRINTED}
                    )
        parts.append(f"### Kept: {what}\n\n{table(rows)}")
    return "\n".join(parts)
