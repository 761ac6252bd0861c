"""A sentence for each knob, and the three verdicts that they make."""

from __future__ import annotations

from typing import NamedTuple

import pandas as pd

from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import Verdict

from . import arithmetic, findings, ladders, lambdas, nodes, solvers

#: The confirmed rule may take so many times as long as the fewest nodes that keep the energy.
DEAR = 2.0
NAMES = {"scheme-i": "Scheme I", "scheme-iii": "Scheme III", "scheme-iii-suzuki-4": "The composition of III of order 4"}


class Said(NamedTuple):
    """A sentence of a knob, whether what was expected is so, and the same in a few words."""

    text: str
    holds: bool
    short: str


def lam(errors: pd.DataFrame) -> Said | None:
    """Which lambda is best for which scene, and whether it is 1/2."""
    found = findings.best_lambdas(errors)
    if found.empty:
        return None
    coarse, fine = (found[found["finer"] == k] for k in (found["finer"].min(), found["finer"].max()))
    held = int(coarse["half is best"].sum())
    short = f"λ = 1/2 has the least trajectory error in {held} of {len(coarse)} cases of a scheme and a scene"
    parts = []
    for id, part in coarse.groupby("method", sort=False):
        finer = fine[fine["method"] == id]["best"]
        most = part.loc[part["gain"].idxmax()]
        parts.append(
            f"{NAMES.get(id, id)} is best at {_span(part['best'])}, with a smaller h at {_span(finer)}; 1/2 has up to "
            f"{number(most['gain'], 2)} times the least error ({most['scene']})"
        )
    return Said(f"{short}. {'. '.join(parts)}.", held == len(coarse), f"{short}.")


def _span(values: pd.Series) -> str:
    low, high = number(float(values.min()), 2), number(float(values.max()), 2)
    return f"λ = {low}" if low == high else f"λ = {low} to {high}"


def stable(costs: pd.DataFrame) -> Said | None:
    """Whether the step can be longest at 1/2."""
    found = findings.longest(costs)
    if found.empty:
        return None
    held = int(found["half is longest"].sum())
    off = [
        f"{NAMES.get(r['method'], r['method'])} on {r['scene']}"
        for _, r in found.iterrows()
        if not r["half is longest"]
    ]
    text = f"The largest step that survives is longest at λ = 1/2 in {held} of {len(found)}"
    text += f"; not of {listed(off, 3)}" if off else ""
    text += f"; a step takes the fewest gradients at {_explicit(costs)}."
    return Said(text, held == len(found), text)


def _explicit(costs: pd.DataFrame) -> str:
    """The lambdas where steps take the fewest gradients in the mean, and how many times as many they take at 1/2."""
    mean = costs.groupby("lam")["gradients per step"].mean()
    least = mean[mean <= findings.SAME * mean.min()]
    fewer = number(mean[findings.HALF] / mean.min(), 2)
    return f"λ = {listed([number(float(x), 2) for x in least.index])}, {fewer} times fewer than at 1/2"


def composition(rungs: pd.DataFrame) -> Said | None:
    """Which order is the cheapest at which error: it should rise as the error falls."""
    found = findings.cheapest(rungs, ladders.COMPOSITION)
    if found.empty:
        return None
    falls = [
        scene
        for scene, part in found.groupby("scene", sort=False)
        if not part.sort_values("error", ascending=False)["setting"].astype(int).is_monotonic_increasing
    ]
    text = f"The cheapest order of a composition: {_scenes(found)}"
    text += f"; it does not rise with accuracy on {listed(falls, 3)}." if falls else "."
    return Said(text, not falls, text)


def _scenes(found: pd.DataFrame) -> str:
    return "; ".join(f"{scene}: {findings.ranges(part)}" for scene, part in found.groupby("scene", sort=False))


def generating(rungs: pd.DataFrame) -> Said | None:
    """Whether a higher r pays: the cheapest at the smallest error has a higher r than at the largest."""
    found = findings.cheapest(rungs, ladders.GENERATING)
    if found.empty:
        return None
    idle = []
    for scene, part in found.groupby("scene", sort=False):
        names = part.sort_values("error", ascending=False)["setting"]
        if not _r(names.iloc[-1]) > _r(names.iloc[0]):
            idle.append(scene)
    text = f"The cheapest generating function: {_scenes(found)}"
    text += f"; a higher r does not pay on {listed(idle, 3)}." if idle else "; a higher r pays as the error falls."
    return Said(text, not idle, text)


def _r(setting: str) -> int:
    return ladders.SETTINGS[ladders.GENERATING][setting][1]["order"]


def energy(rungs: pd.DataFrame) -> Said | None:
    """Who is the cheapest of those that keep the energy: a scheme of the talk somewhere on every scene."""
    found = findings.cheapest(rungs, ladders.ENERGY)
    if found.empty:
        return None
    without = [
        s for s, part in found.groupby("scene", sort=False) if not part["setting"].str.startswith("scheme-").any()
    ]
    text = f"At equal energy error (at most {findings.KEPT:g}) the cheapest is: {_scenes(found)}"
    text += f"; Schemes IV and V are nowhere the cheapest on {listed(without, 3)}." if without else "."
    return Said(text, not without, text)


def quadrature(table: pd.DataFrame) -> Said | None:
    """How many nodes keep the energy, and whether the confirmed rule is as good and not much dearer."""
    found = findings.quadratures(table)
    if found.empty:
        return None
    off = found[~((found["confirmed"] <= findings.FLOOR) & (found["confirmed / fewest"] <= DEAR))]
    few, cost, dear = found["nodes"], found["cost"], found["confirmed / fewest"]
    text = (
        f"AVF keeps the energy to {findings.FLOOR:g} with {few.min()} to {few.max()} nodes, which take "
        f"{number(cost.min(), 2)} to {number(cost.max(), 2)} times as long as one; the rule that confirms itself takes "
        f"{number(dear.min(), 2)} to {number(dear.max(), 2)} times as long as the fewest that do"
    )
    names = [f"{r['scene']}, h = {number(r['h'])}" for _, r in off.iterrows()]
    text += f"; too dear, or not kept: {listed(names, 3)}." if names else "."
    return Said(text, not names, text)


def compensation(table: pd.DataFrame, costs: pd.DataFrame | None = None) -> Said | None:
    """What compensated sums leave of round-off, and what they cost at most."""
    found = findings.sums(table)
    if found.empty:
        return None
    gains = [f"{number(r['gain'], 2)} times after {r['steps']} steps ({r['scene']})" for _, r in found.iterrows()]
    text = f"Plain sums leave more round-off than compensated ones: {listed(gains, 3)}"
    if costs is not None and len(costs):
        low, high = costs["ratio"].min(), costs["ratio"].max()
        text += f"; a step takes {number(low, 2)} to {number(high, 2)} times as long as the bare C loop's by plain sums"
    return Said(f"{text}.", bool((found["gain"] > 1).all()), f"{text}.")


def single(table: pd.DataFrame) -> Said | None:
    """Where single precision ends."""
    found = findings.sums(table)
    if found.empty:
        return None
    floors = [
        f"{number(r['floor of single'], 2)} at h = {number(r['at h'])} ({r['scene']})" for _, r in found.iterrows()
    ]
    over = bool((found["floor of single"] > found["error of doubles"]).all())
    text = f"Single precision goes down to {listed(floors, 3)}"
    text += ", doubles go further." if over else ", and doubles no further with these steps."
    return Said(text, over, text)


def solving(table: pd.DataFrame) -> Said | None:
    """Fixed point or Newton, from which start, to which tolerance: whether the engine's way is the one to take."""
    found = findings.solving(table)
    if found.empty:
        return None
    dear = found[found["engine"] > findings.SAME]
    lost, both = found[found["fixed"].isna()], found.dropna(subset=["fixed", "simplified"])
    text = (
        f"To solve the stages of {solvers.METHOD} the engine takes {_range(found['engine'])} times the evaluations of "
        f"the best of a plain loop"
    )
    text += f", more than it need on {_cases(dear)}" if len(dear) else ""
    if len(both):
        text += f"; there simplified Newton takes {_range(both['simplified'] / both['fixed'])} of the fixed point's"
    if found["five"].notna().any():
        text += f", which from five steps takes {_range(found['five'].dropna())} of those from zero"
    text += f" and does not converge on {_cases(lost)}" if len(lost) else ""
    loose = found.dropna(subset=["loosest"])
    if len(loose):
        text += (
            f"; a tolerance of {loose['loosest'].min():.0e} to {loose['loosest'].max():.0e} leaves the error as it is "
            f"and saves {_range(100 * loose['saved'])} % of the evaluations"
        )
    return Said(f"{text}.", dear.empty, f"{text.partition(';')[0]}.")


def _range(values: pd.Series) -> str:
    return f"{number(float(values.min()), 2)} to {number(float(values.max()), 2)}"


def _cases(found: pd.DataFrame) -> str:
    return listed([f"{r['scene']}, h = {number(r['h'])}" for _, r in found.iterrows()], 3)


def _joined(parts: list[Said | None]) -> Verdict | None:
    said = [part for part in parts if part is not None]
    if not said:
        return None
    first = next((part for part in said if not part.holds), said[0])
    return Verdict(" ".join(part.text for part in said), all(part.holds for part in said), first.short)


def _of(data, name: str, *say):
    """The sentences of a table, none where it was not measured."""
    table = data(name)
    return [] if table is None or table.empty else [function(table) for function in say]


def best_lambda(data) -> Verdict | None:
    """Lambda: which is best, and is it 1/2?"""
    return _joined(_of(data, lambdas.ERRORS, lam) + _of(data, lambdas.COSTS, stable))


def cheapest_settings(data) -> Verdict | None:
    """The order, the r of a generating function, and who keeps the energy at what cost."""
    return _joined(_of(data, ladders.TABLE, composition, generating, energy))


def round_off(data) -> Verdict | None:
    """Nodes, the solver, sums and the length of a number."""

    def summed(table: pd.DataFrame) -> Said | None:
        return compensation(table, data(arithmetic.COSTS))

    said = _of(data, nodes.TABLE, quadrature) + _of(data, solvers.TABLE, solving)
    return _joined(said + _of(data, arithmetic.ERRORS, summed, single))
