"""``certify``: everything measured of an integrator and judged, as one object.

from phasebench.benchmarks.certificate.certificate import certify
print(certify("./mine.py", {"order": 4}).verdict)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks.rows.provenance import versions
from phasebench.integrators.engine.codegen import DOUBLE, MULTIPRECISION

from . import adaptive, battery, behaviour, conservation, judge, structure
from .battery import Entry
from .order import order
from .place import measured, place, scenes
from .stepping import DIGITS, StepFailed, Stepper
from .subject import Subject, subject
from .times import timed_or_failed
from .verdicts import CONSERVED, Judged, Tables

if TYPE_CHECKING:
    import pandas as pd

#: What is told of the versions.
PACKAGES = ("phasebench", "python", "numpy", "numba", "sympy", "mpmath")
#: Rows have these for figures alone.
CURVES = ("curve", "sizes", "radius")
DEFECTS = {
    "symplectic": structure.symplecticity,
    "symmetric": structure.symmetry,
    "reversible": structure.reversibility,
}

#: Claim -> the measure that judges it, where that is of another name; and all measures but those that are always made.
MEASURE = dict.fromkeys(CONSERVED, "long")
EVERYTHING = {*DEFECTS, "stability", "long", "round_off", "place"}


@dataclass(frozen=True)
class Certificate:
    """What was measured of an integrator, and what that says of its claims.

    Attributes
    ----------
    integrator : its name, or the path of its file
    claims : the verdicts, first on what every integrator is held to
    offers : claims that would hold and are not made
    verdict : "pass", "fail" or "not-judged"
    tables : the rows of every measure
    doubles : why it was measured in doubles alone; "" where it was in many digits
    requires : traits that it requires of a system
    seed : of the states
    seconds : that it took
    times : of each scene on which it has a place, what it takes beside the fastest stored
    """

    integrator: str
    claims: list[Judged]
    offers: list[str]
    verdict: str
    tables: Tables
    doubles: str
    requires: tuple[str, ...]
    seed: int
    seconds: float
    times: list[dict] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it; ``seconds`` and ``times`` alone differ when it is made again."""
        rows = {name: [_without_curves(r) for r in part] for name, part in self.tables.rows.items()}
        return {
            "integrator": self.integrator,
            "claims": [j.row() for j in self.claims],
            "measured": rows,
            "verdict": self.verdict,
            "offers": self.offers,
            "failed": dict(self.tables.failed),
            "arithmetic": f"doubles: {self.doubles}" if self.doubles else f"{DIGITS} digits, long runs in doubles",
            "requires": list(self.requires),
            "seed": self.seed,
            "versions": {name: versions().get(name, "absent") for name in PACKAGES},
            "seconds": self.seconds,
            "times": self.times,
        }

    def frame(self) -> pd.DataFrame:
        """A row a claim: claim, verdict, measured, interval, on, why; ``attrs`` has the verdict and the offers."""
        import pandas as pd

        frame = pd.DataFrame([j.row() for j in self.claims])
        frame.attrs |= {"integrator": self.integrator, "verdict": self.verdict, "offers": self.offers}
        return frame

    def summary(self) -> str:
        """Lines of text: the verdict, each claim, what could be claimed."""
        lines = [f"{self.integrator}: {self.verdict}"]
        for j in self.claims:
            measured = f" ({j.measured:.3g})" if isinstance(j.measured, float) else ""
            lines.append(f"  {j.claim}: {j.verdict}{measured}{f'; {j.why}' if j.why else ''}")
        if self.offers:
            lines.append(f"  measured and not claimed: {self.offered()}")
        return "\n".join(lines)

    def offered(self) -> str:
        """What could be claimed, as options of the command."""
        return " ".join(f"--claim {offer}" for offer in self.offers)


def _without_curves(row: dict) -> dict:
    return {key: value for key, value in row.items() if key not in CURVES}


def certify(
    target,
    claims: Mapping[str, Any] | None = None,
    requires: tuple[str, ...] = (),
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    alone: bool = False,
) -> Certificate:
    """Measure an integrator on the battery and judge its claims.

    Parameters
    ----------
    target, claims, requires : as of `subject.subject`
    seed : of the states at which it is measured
    progress : told what is measured
    alone : measure what is claimed alone; nothing is offered then

    Raises
    ------
    InvalidInput
        For a target or a claim that cannot be used.  What the integrator does wrong is in the certificate.
    """
    began = time.perf_counter()
    chosen = subject(target, claims, requires)
    tables, tell = Tables(), progress or (lambda what: None)
    doubles = "an adaptive integrator has no step" if chosen.adaptive else ""
    try:
        if chosen.adaptive:
            _adaptive(chosen, tables, seed, tell)
            if not alone:
                _place(chosen, tables, tell)
        else:
            wanted = {MEASURE.get(name, name) for name in chosen.own.claims} if alone else EVERYTHING
            doubles = _step(chosen, tables, seed, tell, wanted)
    except StepFailed as failure:
        tables.failed["raised"] = str(failure)
    found = judge.judged(chosen.own.claims, tables)
    times = _times(chosen, tables, tell)
    return Certificate(
        chosen.id,
        found,
        [] if alone or judge.gross_failure(found) else judge.offers(chosen.own.claims, tables),
        judge.verdict(found, chosen.own.claims),
        tables,
        doubles,
        chosen.own.requires,
        seed,
        time.perf_counter() - began,
        times,
    )


def validate(
    target, *, requires: str | tuple[str, ...] = (), output: str | Path | None = None, seed: int = 0, **claims
) -> pd.DataFrame:
    """Judge what an integrator claims: ``validate(step, order=4, symplectic=True)``.

    Parameters
    ----------
    target : a function ``step(system, q, p, h) -> (q, p)`` or ``run(system, q, p, t_end, tol) -> (q, p)``, the path of
        a file with one, ``"package.module:callable"``, coefficients (a mapping, or the path of a JSON file), or the id
        of a method or a peer
    requires : traits of the systems that it can do, such as "separable"
    output : a folder, in which the certificate is written as Markdown, HTML and JSON
    seed : of the states at which it is measured
    claims : order, symplectic, symmetric, reversible, energy, bilinear, quadratic, stability, tolerance

    Returns
    -------
    pandas.DataFrame
        A row a claim: claim, verdict ("holds", "contradicted", "not-judged"), measured, interval, on, why.
        ``frame.attrs["verdict"]`` is "pass", "fail" or "not-judged", ``frame.attrs["offers"]`` what could be claimed.

    Raises
    ------
    InvalidInput
        For a target or a claim that cannot be used.
    """
    requires = (requires,) if isinstance(requires, str) else tuple(requires)
    if output is not None:
        from .render import writable

        writable(output)
    found = certify(target, claims, requires, seed)
    if output is not None:
        from .render import write

        write(found, output)
    return found.frame()


def _able(chosen: Subject, entries, tables: Tables) -> list[Entry]:
    able = [e for e in entries if chosen.lacks(e.system) is None]
    if not able:
        tables.failed["runs"] = (
            f"the battery has no system of the kind that it requires: {', '.join(chosen.own.requires)}"
        )
    return able


def _step(chosen: Subject, tables: Tables, seed: int, tell, wanted) -> str:
    """Fill the tables of a step; why it was measured in doubles alone, or ""."""
    entries = _able(chosen, battery.entries(), tables)
    if not entries:
        return ""
    tell("first steps")
    tables.rows["runs"] = behaviour.runs(chosen, entries, seed)
    if any(r["status"] != "ok" for r in tables.rows["runs"]):
        tables.failed["all"] = "it does not run"
        return ""
    tables.rows["state"] = behaviour.state_between_steps(chosen, entries, seed)
    tables.rows["input"] = behaviour.input_changed(chosen, entries, seed)
    doubles = behaviour.arithmetic(chosen, entries, seed)
    arithmetics = (DOUBLE,) if doubles else (MULTIPRECISION, DOUBLE)
    for entry in entries:
        tell(f"order on {entry.name}")
        row = _first_that_runs(lambda a, e=entry: order(Stepper(chosen, e, a), seed), arithmetics)
        tables.rows.setdefault("order", []).append(row | {"separable": entry.system.separable})
    for name in (name for name in DEFECTS if name in wanted):
        tell(name)
        for entry in entries:
            if entry.reversible or name != "reversible":
                row = _structure(chosen, entry, seed, DEFECTS[name], arithmetics)
                tables.rows.setdefault(name, []).append(row | {"separable": entry.system.separable})
    if "stability" in wanted and chosen.lacks(battery.oscillator().system) is None:
        tell("stability")
        tables.rows["stability"] = [behaviour.stability(chosen)]
    for entry in _able(chosen, battery.lasting(), tables) if "long" in wanted else ():
        tell(f"a long run on {entry.name}")
        tables.rows.setdefault("long", []).append(conservation.long_run(chosen, entry, seed))
    if "round_off" in wanted and not doubles:
        tables.rows["round_off"] = [conservation.round_off(chosen, entries[min(1, len(entries) - 1)], seed)]
    if "place" in wanted:
        _place(chosen, tables, tell)
    return doubles


def _place(chosen: Subject, tables: Tables, tell) -> None:
    """Where it stands beside the trade's integrators, unless it is no step of the system."""
    if judge.gross_failure(judge.judged({}, tables)):
        return
    for scene in scenes(chosen):
        tell(f"its place on {scene}")
        tables.rows.setdefault("place", []).append(place(chosen, scene))


def _times(chosen: Subject, tables: Tables, tell) -> list[dict]:
    """What it takes in time on the scenes on which it has a place."""
    out = []
    for row in tables.of("place"):
        tell(f"its time on {row['on']}")
        out.append(timed_or_failed(chosen, row, measured))
    return [x for x in out if x is not None]


def _first_that_runs(measure: Callable[[str], dict], arithmetics) -> dict:
    """``measure`` in the first arithmetic that the step takes; what it raises in doubles is raised."""
    for arithmetic in arithmetics[:-1]:
        try:
            return measure(arithmetic)
        except StepFailed:
            continue
    return measure(arithmetics[-1])


def _structure(chosen, entry, seed, defect, arithmetics) -> dict:
    try:
        return _first_that_runs(lambda a: structure.measured(Stepper(chosen, entry, a), seed, defect), arithmetics)
    except StepFailed as failure:
        if defect is not structure.symmetry:
            raise
        # A step backwards is not promised.
        return {"on": entry.name, "status": "failed", "reason": f"with -h: {failure}"}


def _adaptive(chosen: Subject, tables: Tables, seed: int, tell) -> None:
    entries = _able(chosen, battery.entries(), tables)
    tables.failed["all"] = "an adaptive integrator has no step map of constant h to test"
    for entry in entries:
        tell(f"tolerances on {entry.name}")
        try:
            row = adaptive.tolerances(chosen, entry, seed)
        except adaptive.InputChanged:
            tables.rows.setdefault("input", []).append({"on": entry.name, "value": 1.0, "later": 0.0})
            continue
        tables.rows.setdefault("runs", []).append({"on": entry.name, "status": "ok", "reason": ""})
        tables.rows.setdefault("input", []).append({"on": entry.name, "value": 0.0, "later": 0.0})
        same = {"on": entry.name, "what": "the same run twice", "value": 0.0 if row["repeats"] else 1.0}
        tables.rows.setdefault("state", []).append(same)
        tables.rows.setdefault("tolerance", []).append(row)
