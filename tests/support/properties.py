"""Measure structural properties of methods on random systems: symplecticity, symmetry, conservation; prints JSON.

It needs a process with NUMBA_DISABLE_JIT=1. Each property of the methods in `METHODS` is measured in multiprecision,
then once more, for some, with one coefficient of the method changed by the relative amount `SLIP`. Runs in double
precision follow.
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

from phasebench.benchmarks.measure.multiprecision import advance
from phasebench.benchmarks.measure.step_map import pair_defect
from phasebench.integrators.compile.codegen import compiled, precision, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import method
from support.random_systems import Case, cases, draws, with_bilinear, with_linear

DIGITS, SLIP = 30, 1e-9
#: A larger defect shows that a property does not hold; no further cases are measured then.
VISIBLE = 1e-16
#: At least one method of each family that accepts a general Hamiltonian.
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
    "tao-2",
    "pihajoki-2",
    "jayawardana-ohsawa-2",
)
#: Adjoint methods, except where the adjoint is the same method with 1 - lambda.
ADJOINTS = {"explicit-euler": "implicit-euler", "symplectic-euler-p": "symplectic-euler-q", "pavf": "pavf-adjoint"}
WITH_LAMBDA = ("scheme-i", "scheme-ii", "generating-function")


class Slip(NamedTuple):
    """A planted fault: a coefficient of a method's step is off by the relative amount `SLIP`.

    Attributes
    ----------
    id : the method
    field : name of the array of coefficients; its first entry other than 0 and 1 is changed
    breaks, keeps : the properties that the fault destroys, and those that it does not
    all : True if all entries other than 0 and 1 are changed
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
    Slip("scheme-i", "mu", ("symplecticity", "adjoint", "bilinear"), ("linear",)),  # lambda then differs for q and p
    Slip("scheme-iii", "mu", ("symplecticity", "symmetry", "bilinear")),
    Slip("gauss-2", "A", ("symplecticity", "symmetry", "bilinear"), ("linear",)),
    Slip("lobatto-iiia-iiib-3", "A_p", ("symplecticity", "symmetry")),
    Slip("variational-gauss-2", "b", ("symmetry",)),
    Slip("scheme-v", "sign", ("symmetry",), ("energy",)),
    Slip("mclachlan-atela-4", "a", (), ("symplecticity", "bilinear")),  # for any lengths of drifts and kicks
    Slip("avf", "c", ("energy", "symmetry"), ("linear",), all=True),
    Slip("pavf", "c", ("energy", "adjoint"), all=True),
    Slip("hbvm-4-2", "B", ("energy",)),
    Slip("jayawardana-ohsawa-2", "a", (), ("symplecticity", "bilinear", "linear")),  # for any lengths of substeps
)


def lam_of(record, case: Case):
    """Return (the method, with the random case's lambda if it takes one, step size).

    The step is reduced for a large lambda.
    """
    if "lam" not in record.parameters:
        return record, case.h
    return record(lam=case.lam), case.h / (1 + abs(case.lam))


def start(case: Case):
    """Return the initial state (q, p) of a random case, as one vector of multiprecision numbers."""
    return vector([*case.q, *case.p])


def symplecticity(record, case: Case):
    """Return the defect of the symplectic form, on one pair of tangent vectors, in a step of a method on a random case.

    ``record`` is the method.
    """
    record, h = lam_of(record, case)
    return pair_defect(lambda y: advance(case.system, record, y, h), start(case))


def take_steps(record, case: Case, y, h, steps=1):
    """Return the state after some steps h of a method from the state y.

    NaN if it is still y: a step that does nothing would preserve everything.
    """
    end = advance(case.system, record, y, h, steps)
    return end if max(abs(end - y)) > 1e-9 else end * float("nan")


def return_distance(record, back, h, case: Case):
    """Return the distance from the start after a step h of the method ``record`` and a step -h of ``back``."""
    y = start(case)
    return max(abs(take_steps(back, case, take_steps(record, case, y, h), -h) - y))


def symmetry(record, case: Case):
    """Return the distance from the start after a step h and a step -h of a method: 0 if it is symmetric."""
    record, h = lam_of(record, case)
    return return_distance(record, record, h, case)


def adjoint(record, case: Case):
    """Return the distance from the start after a step h of a method and a step -h of its declared adjoint.

    It is 0 if the other method is the adjoint.
    """
    other = ADJOINTS.get(record.id)
    record, h = lam_of(record, case)
    return return_distance(record, method(other) if other else record(lam=1 - case.lam), h, case)


def change(quantity: Callable, record, case: Case):
    """Return the change of ``quantity``, a function of (q, p), in two steps of a method on a random case."""
    record, h = lam_of(record, case)
    y = start(case)
    end = take_steps(record, case, y, h, steps=2)
    return abs(quantity(end[: case.d], end[case.d :]) - quantity(y[: case.d], y[case.d :]))


def energy(record, case: Case):
    """Return the change of H in two steps of a method on a random case."""
    H = case.system.energy("multiprecision")
    return change(lambda q, p: H(q, p)[0], record, case)


def linear(record, case: Case):
    """Return the change of a random case's linear invariant w.(q, p) in two steps of a method."""
    w = np.array(case.linear, dtype=object)
    return change(lambda q, p: w @ np.concatenate([q, p]), record, case)


def bilinear(record, case: Case):
    """Return the change of a random case's invariant q.D p in two steps of a method."""
    D = np.array(case.bilinear, dtype=object)
    return change(lambda q, p: q @ D @ p, record, case)


MEASURES = {f.__name__: f for f in (symplecticity, symmetry, adjoint, energy, linear, bilinear)}


def kind(record) -> str:
    """Return the kind of random system on which a method is measured, one of `random_systems.KINDS` or "fast".

    "fast" is a system with a linear part of declared frequencies.
    """
    if record.id == "hbvm-4-2":
        return "polynomial"  # of degree 4: for other H the quadrature error limits conservation
    traits = {"linear fast part": "fast", "quadratic kinetic energy": "quadratic"}
    return next((traits[t] for t in record.requires if t in traits), "any")


def systems(what: str, record) -> tuple[Callable, str, int] | None:
    """Return how to draw random systems on which the property ``what`` of a method is measured.

    It is (Hypothesis strategy, kind of system, largest number d of degrees of freedom); None if it is not measured.
    """
    # The code generated for a generating function grows with the order and with d.
    of, largest = kind(record), {"generating-function": 1, "scheme-ii": 2}.get(record.id, 3)
    if what not in ("linear", "bilinear"):
        return cases, of, largest
    free = {"linear": with_linear, "bilinear": with_bilinear}[what]
    return None if of in ("fast", "polynomial") or largest < 2 else (free, of, largest)


def examples(what: str, record) -> int:
    """Return the number of random systems on which the property ``what`` of a method is measured.

    It is smaller where code generation, or a failing search for a root, takes long.
    """
    if what not in ("linear", "bilinear"):
        return 10
    return 4 if record.id == "scheme-ii" or record.family in ("schemes_iv_v", "equip") else 6


def measure_property(what: str, id: str) -> dict:
    """Find the largest violation of the property ``what`` by the method ``id`` over random systems.

    Returns {"drawn": number of systems, "judged": number of those on which the steps have a solution, "worst": largest
    defect, "case": the system where it occurs, as text}.
    """
    record = method(id)
    found = {"drawn": 0, "judged": 0, "worst": 0.0, "case": ""}
    for case in draw_cases(*systems(what, record), examples(what, record)):
        if not found["worst"] <= VISIBLE:
            break
        found["drawn"] += 1
        try:
            defect = float(MEASURES[what](record, case))
        except ArithmeticError:  # a step without a solution or root promises nothing
            continue
        found["judged"] += 1
        if not defect <= found["worst"]:
            found["worst"], found["case"] = defect, repr(case)
    return found


@cache
def draw_cases(strategy: Callable, kind: str, largest: int, n: int) -> list[Case]:
    """Draw n random cases (systems with an initial state) of a kind, with at most ``largest`` degrees of freedom.

    They are the same for every method, so that code is generated once.
    """
    return draws(strategy(kind, largest), n)


@contextmanager
def plant(slip: Slip):
    """Context manager in which a method's coefficients have the planted fault; yields a list of changed entries.

    Entries 0 and 1 are structure and stay, except in an array of signs.
    """
    family = importlib.import_module(f"phasebench.integrators.families.{method(slip.id).family}")
    right, planted = family.prepare, []

    def wrong(*arguments):
        made = right(*arguments)
        if not hasattr(made.step, slip.field):  # e.g. the kernel for separable H
            return made
        x = np.array(getattr(made.step, slip.field))
        flat = x.reshape(-1)
        place = [k for k, number in enumerate(flat) if slip.field == "sign" or number not in (0, 1)]
        for k in place if slip.all else place[:1]:
            flat[k] = flat[k] * (1 + SLIP)
            planted.append(k)
        return replace(made, step=made.step._replace(**{slip.field: x}))

    with mock.patch.object(family, "prepare", wrong):
        yield planted


def cells() -> list[tuple[str, str]]:
    """List (property, method's id) of all measurements of methods without a planted fault."""
    plain = [(what, id) for what in MEASURES if what != "adjoint" for id in METHODS]
    plain += [("adjoint", id) for id in (*ADJOINTS, *WITH_LAMBDA)]
    return [(what, id) for what, id in plain if systems(what, method(id)) is not None]


def of_all() -> dict:
    """Measure all properties of all methods, also with planted faults.

    Returns {property: {method's id or label of the planted fault: result of `measure_property`}}; with a planted fault
    the result has the number "planted" of coefficients that were changed, too.
    """
    out: dict = {what: {} for what in MEASURES}
    for what, id in cells():
        out[what][id] = measure_property(what, id)
    for slip in SLIPS:
        for what in (*slip.breaks, *slip.keeps):
            with plant(slip) as planted:
                out[what][slip.label] = measure_property(what, slip.id) | {"planted": len(planted)}
    return out


#: Methods whose kernels other tests compile for d = 2, for a general H and for unit masses.
COMPILED = ("rk4", "stormer-verlet", "scheme-i", "scheme-iii", "gauss-2", "avf")
STEPS, STARTS = 10, 12


def ends() -> list[dict]:
    """Run the methods in `COMPILED` in double precision on random systems.

    Returns rows, each with the method's id, the system and its initial state, the status and the end state.
    """
    rows: list[dict] = []
    for kind, formulae in (("any", 2), ("unit", 1)):  # few formulas to compile, many states
        of_kind = cases(kind, largest=2, least=2).filter(lambda c, unit=kind == "unit": c.system.separable == unit)
        drawn = draws(of_kind, STARTS)
        for n, case in enumerate(drawn):
            case = replace(case, H=drawn[-1 - n % formulae].H)
            rows += [{"id": id, "case": asdict(case)} | run(case, id) for id in COMPILED]
    return rows


def run(case: Case, id: str) -> dict:
    """Run a method on a random case in double precision: {"status": ..., "end": end state (q, p)}.

    The numbers are texts in hexadecimal, which is exact.
    """
    record, h = lam_of(method(id), case)
    q, p = ([float(x) for x in y] for y in (case.q, case.p))
    s = integrate(case.system, record, h=float(h), steps=STEPS, q0=q, p0=p)
    return {"status": s.status, "end": [float(x).hex() for x in (*s.q[-1], *s.p[-1])]}


if __name__ == "__main__":
    assert not compiled(), "this process compiles"
    with precision(DIGITS):
        print(json.dumps({"result": {"properties": of_all(), "ends": ends()}}, default=str))
