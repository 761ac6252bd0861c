"""Properties of methods over random systems, for a process with NUMBA_DISABLE_JIT=1: prints JSON.

It measures every property of every method of `METHODS`, without round-off, and again with a coefficient of the kernel
off by `SLIP` of itself; and runs in doubles on plain NumPy.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import cache
from typing import NamedTuple
from unittest import mock

import numpy as np

from phasebench.benchmarks.measure.metrics import pair_defect
from phasebench.benchmarks.measure.multiprecision import advance
from phasebench.integrators.driver import integrate
from phasebench.integrators.engine.codegen import compiled, precision, vector
from phasebench.integrators.registry import method
from support.random_systems import Case, cases, draws, with_bilinear, with_linear

DIGITS, SLIP = 30, 1e-9
#: A defect above it settles that a property does not hold: further examples are not measured.
VISIBLE = 1e-16
#: At least one of each family that integrates a Hamiltonian without a singularity or a Kepler part.
METHODS = (
    "explicit-euler",
    "rk4",
    "implicit-euler",
    "symplectic-euler-p",
    "implicit-midpoint",
    "stormer-verlet",
    "scheme-i",
    "scheme-ii",
    "generating-function",
    "scheme-iii",
    "scheme-iii-yoshida-4",
    "ruth-3",
    "scheme-iv",
    "scheme-v",
    "mclachlan-atela-4",
    "gauss-2",
    "lobatto-iiia-iiib-3",
    "radau-iia-2",
    "hbvm-4-2",
    "cpg-2",
    "gauss-equip-2",
    "variational-gauss-2",
    "avf",
    "pavf",
    "itoh-abe",
    "gonzalez",
    "rk4-projected-energy",
    "stormer-verlet-symmetric-projection",
    "rk4-relaxation",
    "deuflhard",
    "hairer-lubich",
    "cohen-hairer-2",
)
#: Besides those whose adjoint has 1 - lambda for lambda.
ADJOINTS = {"explicit-euler": "implicit-euler", "symplectic-euler-p": "symplectic-euler-q", "pavf": "pavf-adjoint"}
WITH_LAMBDA = ("scheme-i", "scheme-ii", "generating-function")


class Slip(NamedTuple):
    """A fault of a method: the first number of a field of its kernel's step, or ``all`` of them, is off by `SLIP`.

    ``breaks`` and ``keeps`` are the properties that are lost by it and those that are not.
    """

    id: str
    field: str
    breaks: tuple[str, ...]
    keeps: tuple[str, ...] = ()
    all: bool = False

    @property
    def label(self) -> str:
        return f"{self.id} {self.field}"


SLIPS = (
    Slip("scheme-i", "mu", ("symplecticity", "adjoint", "bilinear"), ("linear",)),  # lambda is another for q than for p
    Slip("scheme-iii", "mu", ("symplecticity", "symmetry", "bilinear")),
    Slip("gauss-2", "A", ("symplecticity", "symmetry", "bilinear"), ("linear",)),
    Slip("lobatto-iiia-iiib-3", "A_p", ("symplecticity", "symmetry")),
    Slip("variational-gauss-2", "b", ("symmetry",)),
    Slip("scheme-v", "sign", ("symmetry",), ("energy",)),
    Slip("mclachlan-atela-4", "a", (), ("symplecticity", "bilinear")),  # whatever the lengths of drifts and kicks
    Slip("avf", "c", ("energy", "symmetry"), ("linear",), all=True),
    Slip("pavf", "c", ("energy", "adjoint"), all=True),
    Slip("hbvm-4-2", "B", ("energy",)),
)


def lam_of(record, case: Case):
    """The method with the case's lambda, where it has one, and the step, which is shorter for a large lambda."""
    if "lam" not in record.parameters:
        return record, case.h
    return record(lam=case.lam), case.h / (1 + abs(case.lam))


def start(case: Case):
    return vector([*case.q, *case.p])


def symplecticity(record, case: Case):
    """The defect of one pair of tangent vectors."""
    record, h = lam_of(record, case)
    return pair_defect(lambda y: advance(case.system, record, y, h), start(case))


def moved(record, case: Case, y, h, steps=1):
    """The state after some steps; NaN where they do nothing, which would keep everything."""
    end = advance(case.system, record, y, h, steps)
    return end if max(abs(end - y)) > 1e-9 else end * float("nan")


def returned(record, back, h, case: Case):
    """The distance from the start after a step with h and one of ``back`` with -h."""
    y = start(case)
    return max(abs(moved(back, case, moved(record, case, y, h), -h) - y))


def symmetry(record, case: Case):
    record, h = lam_of(record, case)
    return returned(record, record, h, case)


def adjoint(record, case: Case):
    """As `returned`, by the adjoint method."""
    other = ADJOINTS.get(record.id)
    record, h = lam_of(record, case)
    return returned(record, method(other) if other else record(lam=1 - case.lam), h, case)


def change(quantity: Callable, record, case: Case):
    """How much a function of (q, p) changes in two steps."""
    record, h = lam_of(record, case)
    y = start(case)
    end = moved(record, case, y, h, steps=2)
    return abs(quantity(end[: case.d], end[case.d :]) - quantity(y[: case.d], y[case.d :]))


def energy(record, case: Case):
    H = case.system.energy("multiprecision")
    return change(lambda q, p: H(q, p)[0], record, case)


def linear(record, case: Case):
    w = np.array(case.linear, dtype=object)
    return change(lambda q, p: w @ np.concatenate([q, p]), record, case)


def bilinear(record, case: Case):
    D = np.array(case.bilinear, dtype=object)
    return change(lambda q, p: q @ D @ p, record, case)


MEASURES = {f.__name__: f for f in (symplecticity, symmetry, adjoint, energy, linear, bilinear)}


def kind(record) -> str:
    """The kind of system that a method requires."""
    if record.id == "hbvm-4-2":
        return "polynomial"  # of degree 4: others it keeps to its quadrature's error
    traits = {"linear fast part": "fast", "quadratic kinetic energy": "quadratic"}
    return next((traits[t] for t in record.requires if t in traits), "any")


def systems(what: str, record) -> tuple[Callable, str, int] | None:
    """The strategy of cases on which a property of a method is measured, with what it is given; or None."""
    # The formulae of a generating function grow with the order and with d.
    of, largest = kind(record), {"generating-function": 1, "scheme-ii": 2}.get(record.id, 3)
    if what not in ("linear", "bilinear"):
        return cases, of, largest
    free = {"linear": with_linear, "bilinear": with_bilinear}[what]
    return None if of in ("fast", "polynomial") or largest < 2 else (free, of, largest)


def examples(what: str, record) -> int:
    """How many cases are drawn: fewer where formulae, or the search for roots that are not there, take long."""
    if what not in ("linear", "bilinear"):
        return 10
    return 4 if record.id == "scheme-ii" or record.family in ("schemes_iv_v", "equip") else 6


def measured(what: str, id: str) -> dict:
    """{drawn, judged: how many cases; worst: the largest defect; case: where it is}."""
    record = method(id)
    found = {"drawn": 0, "judged": 0, "worst": 0.0, "case": ""}
    for case in drawn(*systems(what, record), examples(what, record)):
        if not found["worst"] <= VISIBLE:
            break
        found["drawn"] += 1
        try:
            defect = float(MEASURES[what](record, case))
        except ArithmeticError:  # no solution of its equations, no root: nothing is promised there
            continue
        found["judged"] += 1
        if not defect <= found["worst"]:
            found["worst"], found["case"] = defect, repr(case)
    return found


@cache
def drawn(strategy: Callable, kind: str, largest: int, n: int) -> list[Case]:
    """Cases of a kind: the same for every method, so that their formulae are derived once."""
    return draws(strategy(kind, largest), n)


@contextmanager
def slipped(slip: Slip):
    """With that fault in the method's family; the numbers 0 and 1 are structure and stay, but signs do not."""
    family = importlib.import_module(f"phasebench.integrators.families.{method(slip.id).family}")
    right = family.prepare

    def wrong(*arguments):
        made = right(*arguments)
        if not hasattr(made.step, slip.field):  # the kernel that serves a separable H has other fields
            return made
        x = np.array(getattr(made.step, slip.field))
        flat = x.reshape(-1)
        place = [k for k, number in enumerate(flat) if slip.field == "sign" or number not in (0, 1)]
        for k in place if slip.all else place[:1]:
            flat[k] = flat[k] * (1 + SLIP)
        return replace(made, step=made.step._replace(**{slip.field: x}))

    with mock.patch.object(family, "prepare", wrong):
        yield


def cells() -> list[tuple[str, str]]:
    """(property, method) of all that is measured of the methods as they are."""
    plain = [(what, id) for what in MEASURES if what != "adjoint" for id in METHODS]
    plain += [("adjoint", id) for id in (*ADJOINTS, *WITH_LAMBDA)]
    return [(what, id) for what, id in plain if systems(what, method(id)) is not None]


def of_all() -> dict:
    """{property: {method, or label of a slip: `measured`}}."""
    out: dict = {what: {} for what in MEASURES}
    for what, id in cells():
        out[what][id] = measured(what, id)
    for slip in SLIPS:
        with slipped(slip):
            for what in (*slip.breaks, *slip.keeps):
                out[what][slip.label] = measured(what, slip.id)
    return out


#: Methods whose kernels other tests compile for d = 2, of a formula of any kind and of a unit mass.
COMPILED = ("rk4", "stormer-verlet", "scheme-i", "scheme-iii", "gauss-2", "avf")
STEPS, STARTS = 10, 12


def ends() -> list[dict]:
    """Runs of `COMPILED` in doubles, each with its case, status and end."""
    rows: list[dict] = []
    for kind, formulae in (("any", 2), ("unit", 1)):  # few formulae, as each is compiled; many states and lambdas
        of_kind = cases(kind, largest=2, least=2).filter(lambda c, unit=kind == "unit": c.system.separable == unit)
        drawn = draws(of_kind, STARTS)
        for n, case in enumerate(drawn):
            case = replace(case, H=drawn[-1 - n % formulae].H)
            rows += [{"id": id, "case": asdict(case)} | run(case, id) for id in COMPILED]
    return rows


def run(case: Case, id: str) -> dict:
    """How a run of a method in doubles ended: compiled, or not."""
    record, h = lam_of(method(id), case)
    q, p = ([float(x) for x in y] for y in (case.q, case.p))
    s = integrate(case.system, record, h=float(h), steps=STEPS, q0=q, p0=p)
    return {"status": s.status, "end": [float(x).hex() for x in (*s.q[-1], *s.p[-1])]}


if __name__ == "__main__":
    assert not compiled(), "this process compiles"
    with precision(DIGITS):
        print(json.dumps({"result": {"properties": of_all(), "ends": ends()}}, default=str))
