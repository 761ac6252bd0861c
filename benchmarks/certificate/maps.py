r"""``validate --map``: what a map (q, p) -> (q, p) of any dimension claims, without a system and without a step.

Such are one-turn maps of accelerators, learned maps, trajectories of Hamiltonian Monte Carlo.  With M its Jacobian by
differences, measured at several states,

- symplectic: :math:`M^TJM = J`, relative to the square of the largest entry of M;
- volume: :math:`\det M = 1`, which is the same for d = 1 alone;
- reversible: :math:`R\circ f\circ R\circ f` leaves a state where it is, for the involution R, by default p -> -p;
- invariants: a function of the state is the same after the map; fixed points stay where they are.

A defect counts as seen above 100 times its floor, the round-off of the numbers that it is made from; the displacement
of differences is the one with the least floor.

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), V.1, VI.2.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.judge.evidence import BROKEN, EPS, Tables, between
from phasebench.benchmarks.judge.requirements import NEARLY
from phasebench.benchmarks.judge.verdict import CONTRADICTED, FAIL, HOLDS, OPEN, PASS, UNJUDGED, Judgement
from phasebench.benchmarks.measure import step_map
from phasebench.benchmarks.problems import user_file
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.keywords import check_names
from phasebench.integrators.systems.formula import parse

from .result import Certificate
from .subject import NAMED, imported

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: States at which a map is measured, and the size of their components, where none are given.
STATES, SIZE = 8, 0.5
#: Displacements of differences, relative to the size of the state.
DISPLACEMENTS = (5e-2, 1e-2, 3e-3, 1e-3, 3e-4)
#: Where the floor is above this, nothing is seen.
BLIND = 1e-2
#: Round-off of a sum, in units of eps times its terms.
ROUNDED = 8.0
CLAIMS = ("symplectic", "volume", "reversible", "invariants", "fixed_points")


@dataclass(frozen=True)
class OneMap:
    """A map with what is claimed of it.

    Attributes
    ----------
    id, f : its name, or the path of its file; the function (q, p) -> (q, p), arrays (d,)
    states : the states (n, 2 d), (q, p), at which it is measured
    claims : name (of `CLAIMS`) -> value
    reverse : the involution R, (q, p) -> (q, p)
    eps : the round-off of its arithmetic, that of doubles or of single precision
    """

    id: str
    f: Callable[..., Any]
    states: np.ndarray
    claims: Mapping[str, Any]
    reverse: Callable[..., Any]
    eps: float = EPS

    def __call__(self, y: np.ndarray) -> np.ndarray:
        """The state after the map, array (2 d,); raises InvalidInput if that is not two arrays (d,) of numbers."""
        return self.apply(self.f, y)

    def call(self, f: Callable, q: np.ndarray, p: np.ndarray) -> Any:
        """What ``f`` returns, the map or the involution; what it raises names its line, what it prints is no result."""
        with user_file.users_code(user_file.file_and_object(self.id)[0], "its map"), np.errstate(all="ignore"):
            return f(q, p)

    def apply(self, f: Callable, y: np.ndarray) -> np.ndarray:
        """The state after ``f``, which is the map or the involution."""
        d = len(y) // 2
        pair = self.call(f, y[:d].copy(), y[d:].copy())
        try:
            q, p = (np.array(x, dtype=float) for x in pair)
        except (TypeError, ValueError):
            raise InvalidInput(f"{self.id}: the map returned {_short(pair)}; it must return q, p") from None
        if not q.shape == p.shape == (d,):
            raise InvalidInput(
                f"{self.id}: the map returned q, p of shapes {q.shape}, {p.shape} for ({d},): say D, its degrees of "
                "freedom, in the file, or d="
            )
        return np.concatenate([q, p])


@check_names
def validate_map(
    target: str | Path | Callable[..., Any],
    *,
    symplectic: bool | None = None,
    volume: bool | None = None,
    reversible: bool | Callable[..., Any] | str | None = None,
    invariants: str | Sequence[str] | None = None,
    fixed_points: Sequence[ArrayLike] | None = None,
    d: int | None = None,
    states: Sequence[ArrayLike] | None = None,
    seed: int = 0,
) -> Certificate:
    """Judge what a map claims: ``validate_map(ring, symplectic=True, d=2)``.

    Parameters
    ----------
    target : a function (q, p) -> (q, p) of arrays (d,), the path of a file with such a function ``map``, or
        ``"package.module:callable"``; the file or module may have CLAIMS, D and STATES
    symplectic, volume : True or False, as it is claimed
    reversible : True with p -> -p; or the involution, (q, p) -> (q, p), or its name in the file
    invariants : formulas in q and p, or q1, q2, ..., p1, p2, ...
    fixed_points, states : states (2 d,), (q, p): that stay; at which it is measured
    d : degrees of freedom, by default those of the states, or 1
    seed : of random states, with components below 1/2, where none are given

    Returns
    -------
    Certificate
        As `validate`; its tables have a row for each property and state.

    Raises
    ------
    InvalidInput
        For a map that cannot be found or called, and for a claim that it cannot have.
    """
    given = {"symplectic": symplectic, "volume": volume, "reversible": reversible, "invariants": invariants}
    given |= {"fixed_points": fixed_points}
    claims = {name: value for name, value in given.items() if value is not None}
    return certify_map(target, claims, d=d, states=states, seed=seed)


def certify_map(
    target: str | Path | Callable[..., Any],
    claims: Mapping[str, Any],
    *,
    d: int | None = None,
    states: Sequence[ArrayLike] | None = None,
    seed: int = 0,
) -> Certificate:
    """As `validate_map`, with the claims as name -> value, added to those of the file."""
    began = time.perf_counter()
    one = _read(target, claims, d, states, seed)
    rows: dict[str, list[dict]] = {}
    found = [_runs(one, rows)]
    if found[0].verdict == HOLDS:
        found += [_stateless(one), _pure(one)]
        _measure(one, rows)
        found += [_judged(one, name, value, rows) for name, value in one.claims.items()]
    offers = [n for n in CLAIMS[:3] if n not in one.claims and rows.get(n) and _verdict(rows[n]) == HOLDS]
    kinds = {j.verdict for j in found}
    verdict = FAIL if CONTRADICTED in kinds else PASS if kinds == {HOLDS} and one.claims else OPEN
    seconds = time.perf_counter() - began
    arithmetic = "a map is called in doubles" if one.eps == EPS else "its values are numbers of single precision"
    return Certificate(one.id, found, offers, verdict, Tables(rows), arithmetic, (), seed, seconds)


# -- what is given ----------------------------------------------------------------------------------------------------


def _read(target: Any, claims: Mapping[str, Any], d: int | None, states: Any, seed: int) -> OneMap:
    if callable(target):
        name, f, holder = getattr(target, "__name__", "map"), target, None
    elif NAMED.match(str(target)) and not user_file.is_file(str(target)):
        name = str(target)
        holder, f = imported(name)
    else:
        name = str(target)
        file, dotted = user_file.file_and_object(name)
        if not Path(file).exists():
            raise InvalidInput(f"there is no file {file}; write ./mine.py or package.module:callable")
        holder = user_file.load(file, "map")
        f = getattr(holder, dotted or "map", None)
        if not callable(f):
            raise InvalidInput(f"{file} has no function '{dotted or 'map'}'; write def map(q, p): ... return q, p")
    stated = getattr(holder, "CLAIMS", {})
    if not isinstance(stated, Mapping):
        raise InvalidInput(f"{name}: CLAIMS is {stated!r}; write {{'symplectic': True}}")
    claims = {**stated, **claims}
    d = getattr(holder, "D", None) if d is None else d
    if d is not None and not (isinstance(d, int) and not isinstance(d, bool) and d > 0):
        raise InvalidInput(f"{name}: D, the degrees of freedom, is {d!r}; it must be a positive integer")
    states = getattr(holder, "STATES", None) if states is None else states
    if states is None:
        d = d or _dimension(claims) or 1
        places = np.random.default_rng(seed).uniform(-SIZE, SIZE, (STATES, 2 * d))
    else:
        places = _states(states, d, f"{name}: STATES")
    reverse = claims.get("reversible")
    if isinstance(reverse, str):
        known = [n for n, x in vars(holder or target).items() if callable(x) and not n.startswith("_")]
        if reverse not in known:
            raise unknown_name(f"function of {name}, an involution,", reverse, known)
        reverse = getattr(holder, reverse)
    for claim, value in claims.items():
        _check(name, claim, value)
    reverse = reverse if callable(reverse) else lambda q, p: (q, -p)
    one = OneMap(name, f, places, claims, reverse)
    return replace(one, eps=_round_off(one))


def _dimension(claims: Mapping[str, Any]) -> int | None:
    points = claims.get("fixed_points")
    return _states(points, None, "fixed_points").shape[1] // 2 if points is not None else None


def _states(given: Any, d: int | None, where: str) -> np.ndarray:
    try:
        states = np.array([np.concatenate([np.ravel(x) for x in state]) if np.ndim(state) != 1 else state
                           for state in given], dtype=float)  # fmt: skip
    except (TypeError, ValueError):
        states = np.zeros(0)
    if states.ndim != 2 or not states.size or states.shape[1] % 2 or not np.isfinite(states).all():
        raise InvalidInput(f"{where} is {_short(given)}; write states as [[q1, ..., p1, ...], ...]")
    if d is not None and states.shape[1] != 2 * d:
        raise InvalidInput(f"{where} has states of {states.shape[1]} numbers; for d = {d} it takes {2 * d}")
    return states


def _check(name: str, claim: str, value: Any) -> None:
    if claim not in CLAIMS:
        raise InvalidInput(f"{name}: {unknown_name('claim of a map', str(claim), CLAIMS)}")
    if claim in ("symplectic", "volume") and not isinstance(value, bool):
        raise InvalidInput(f"{name}: {claim} is {value!r}; it must be True or False")
    if claim == "reversible" and not (isinstance(value, (bool, str)) or callable(value)):
        raise InvalidInput(f"{name}: reversible is {value!r}; it must be True, False or an involution (q, p) -> (q, p)")


def _formulas(given: str | Iterable[str], name: str) -> list[str]:
    texts = [given] if isinstance(given, str) else list(given)
    if not texts or not all(isinstance(x, str) for x in texts):
        raise InvalidInput(f"{name}: invariants is {given!r}; write formulas, such as ['q**2 + p**2']")
    return texts


def _short(x: object) -> str:
    text = repr(x)
    return text if len(text) <= 60 else f"{text[:60]} ..."


# -- measured ---------------------------------------------------------------------------------------------------------


def _round_off(one: OneMap) -> float:
    """The round-off of a map's arithmetic: that of single precision where all its values are such numbers."""
    images = np.array([one(y * (1 + np.pi * 1e-3)) for y in one.states])
    with np.errstate(over="ignore"):
        single = np.array_equal(images, images.astype(np.float32)) and images.any()
    return float(np.finfo(np.float32).eps) if single else EPS


def _label(k: int) -> str:
    return f"state {k + 1}"


def _measure(one: OneMap, rows: dict[str, list[dict]]) -> None:
    """Fill the rows of all properties: the defect (value) at a state (on), and its floor."""
    d = one.states.shape[1] // 2
    symbols = {"q": sp.Symbol("q1"), "p": sp.Symbol("p1")} if d == 1 else {}
    symbols |= {f"{x}{k + 1}": sp.Symbol(f"{x}{k + 1}") for x in "qp" for k in range(d)}
    order = [symbols[f"{x}{k + 1}"] for x in "qp" for k in range(d)]
    invariants = []
    for text in _formulas(one.claims["invariants"], one.id) if "invariants" in one.claims else ():
        expression = parse(text, symbols)
        terms = sum(abs(term) for term in sp.Add.make_args(sp.expand(expression)))
        invariants.append((text, sp.lambdify([order], expression, "numpy"), sp.lambdify([order], terms, "numpy")))
    for k, y in enumerate(one.states):
        image, size = one(y), float(np.abs(y).max()) or 1.0
        M = _differences(one, y, size, rows, _label(k))
        growth = 1 + np.abs(M).max()
        there = one.apply(one.reverse, image)
        defect = np.abs(one.apply(one.reverse, one(there)) - y).max() / size
        rows.setdefault("reversible", []).append(
            {"on": _label(k), "value": float(defect), "floor": ROUNDED * one.eps * growth**2}
        )
        for text, value, terms in invariants:
            change = abs(float(value(image) - value(y)))
            floor = ROUNDED * one.eps * float(terms(image) + terms(y)) * growth
            rows.setdefault("invariants", []).append({"on": _label(k), "of": text, "value": change, "floor": floor})
    for point in _states(one.claims["fixed_points"], d, "fixed_points") if "fixed_points" in one.claims else ():
        size = float(np.abs(point).max()) or 1.0
        growth = 1 + np.abs(_differences(one, point, size, {}, "")).max()
        row = {"on": _short(point.tolist()), "value": float(np.abs(one(point) - point).max() / size)}
        rows.setdefault("fixed_points", []).append(row | {"floor": ROUNDED * one.eps * growth})


def _differences(one: OneMap, y: np.ndarray, size: float, rows: dict[str, list[dict]], on: str) -> np.ndarray:
    """Measure symplecticity and volume at y, each by the differences with the least floor; returns a Jacobian."""
    best: dict[str, dict] = {}
    kept, least = np.eye(len(y)), np.inf
    for displacement in DISPLACEMENTS:
        delta = displacement * size
        M, wider = (step_map.jacobian(one, y, step) for step in (delta, 2 * delta))
        if not np.isfinite(M).all() or not np.isfinite(wider).all():
            continue
        noise = np.abs(wider - M).max() + ROUNDED * one.eps * np.abs(one(y)).max() / delta
        scale = max(1.0, np.abs(M).max())
        if noise / scale < least:
            kept, least = M, noise / scale
        try:
            spread = np.abs(np.linalg.inv(M)).sum()
        except np.linalg.LinAlgError:
            spread = 1.0
        form = float(step_map.symplecticity_defect(M))
        found = {
            "symplectic": (form / scale**2, 2 * len(y) * noise / scale),
            "volume": (float(abs(step_map.determinant(M) - 1)), noise * spread),
        }
        for name, (value, floor) in found.items():
            if name not in best or floor < best[name]["floor"]:
                best[name] = {"on": on, "value": value, "floor": float(floor)}
    for name, row in best.items():
        rows.setdefault(name, []).append(row)
    return kept


# -- judged -----------------------------------------------------------------------------------------------------------


def _runs(one: OneMap, rows: dict[str, list[dict]]) -> Judgement:
    good = [bool(np.isfinite(one(y)).all()) for y in one.states]
    rows["runs"] = [{"on": _label(k), "status": "ok" if x else "diverged"} for k, x in enumerate(good)]
    bad = [_label(k) for k, x in enumerate(good) if not x]
    why = f"it has no finite value at {', '.join(bad)}: say STATES, at which it has" if bad else ""
    verdict = CONTRADICTED if bad else HOLDS
    return Judgement(verdict, "diverged" if bad else "ok", None, tuple(bad), why, "runs", "it runs")


def _stateless(one: OneMap) -> Judgement:
    first = [one(y) for y in one.states]
    apart = max(float(np.abs(one(y) - a).max()) for y, a in zip(one.states[::-1], first[::-1], strict=True))
    why = f"equal calls differ by {apart:.1e}" if apart else "equal in every bit"
    verdict = CONTRADICTED if apart > NEARLY else HOLDS
    return Judgement(verdict, apart, None, (), why, "stateless", "equal calls, equal results")


def _pure(one: OneMap) -> Judgement:
    d = one.states.shape[1] // 2
    why, last = "", None
    for y in one.states:
        q, p = y[:d].copy(), y[d:].copy()
        new = one.call(one.f, q, p)
        if not (np.array_equal(q, y[:d]) and np.array_equal(p, y[d:])):
            why = "it changes its q or p: write q = q + ..., not q += ..."
        if last is not None and not all(np.array_equal(a, b) for a, b in zip(*last, strict=True)):
            why = why or "a call changes what the last call returned"
        last = new, [np.array(x) for x in new]
    return Judgement(CONTRADICTED if why else HOLDS, why=why, name="input", claim="input is left alone")


def _verdict(rows: list[dict]) -> str:
    if any(r["value"] > BROKEN * r["floor"] for r in rows):
        return CONTRADICTED
    return UNJUDGED if any(between(r) or r["floor"] > BLIND for r in rows) else HOLDS


def _judged(one: OneMap, name: str, value: Any, rows: dict[str, list[dict]]) -> Judgement:
    """Judge one claim by its rows; a claim of False holds where a defect is seen."""
    of = rows.get(name, [])
    words = {"invariants": "invariants: ", "fixed_points": "fixed points: "}.get(name, "")
    said = value.__name__ if callable(value) else value
    claim = f"{words}{said}" if words else name if value is True else f"{name}: {said}" if value else f"not {name}"
    if name == "reversible" and (lack := _no_involution(one)):
        return Judgement(CONTRADICTED, None, None, (), lack, name, claim)
    if not of:
        return Judgement(UNJUDGED, why="its differences left the numbers", name=name, claim=claim)
    worst = max(of, key=lambda r: r["value"] / r["floor"])
    seen = _verdict(of)
    verdict = seen if value is not False or seen == UNJUDGED else HOLDS if seen == CONTRADICTED else CONTRADICTED
    what = f"{worst['of']} changes by" if "of" in worst else "a defect of"
    why = f"{what} {worst['value']:.1e} at {worst['on']}, floor {worst['floor']:.0e}"
    return Judgement(verdict, worst["value"], None, tuple(r["on"] for r in of), why, name, claim)


def _no_involution(one: OneMap) -> str:
    for y in one.states:
        back = one.apply(one.reverse, one.apply(one.reverse, y))
        apart = float(np.abs(back - y).max()) / (float(np.abs(y).max()) or 1.0)
        if not apart <= 1e3 * one.eps:
            return f"R is no involution: applied twice it moves a state by {apart:.1e} of its size"
    return ""
