"""Kernels by family: prepared for a method and a system, compiled once per family and kind of state."""

from __future__ import annotations

import hashlib
import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import types

from . import codegen, progress
from .codegen import DOUBLE, MULTIPRECISION


@dataclass(frozen=True)
class Prepared:
    """A kernel's ``run`` with what it needs besides the state.

    Attributes
    ----------
    functions : the kernel's leading arguments (None where it can do without)
    plan, table : its coefficients, two-dimensional arrays, or functions of the step h that make them
    width, slots : components of a stage's unknown, and the number of such unknowns in a step
    implicit, hessian : whether evaluations count as iterations, and as evaluations of higher derivatives
    linear : the number of unknowns of the largest linear system that the kernel solves, at first ``width``
    begin : begin(table, q, p) is called once with the initial state, for values that are kept (H0)
    missed : what a fallback is, in words after "n of m steps"; without it fallbacks do not change the status
    """

    run: Callable
    functions: tuple
    plan: Any
    table: Any
    width: int
    slots: int
    implicit: bool = True
    hessian: bool = False
    linear: int = 0
    begin: Callable | None = None
    missed: str = ""


def array(rows, arithmetic: str):
    """A two-dimensional array of exact numbers in the arithmetic at hand."""
    rows = [list(r) for r in rows]
    out = zeros((len(rows), max(map(len, rows), default=1)), arithmetic)
    for i, r in enumerate(rows):
        for j, x in enumerate(r):
            out[i, j] = codegen.exactly(x, arithmetic)
    return out


def zeros(shape, arithmetic: str):
    """Zeros of the arithmetic at hand."""
    if arithmetic == MULTIPRECISION:
        out = np.empty(shape, dtype=object)
        out.fill(codegen.exactly(0, arithmetic))
        return out
    return np.zeros(shape)


def prepare(method, system, arithmetic: str = DOUBLE) -> Prepared:
    """The kernel of ``method`` for ``system``."""
    family = importlib.import_module(f"phasebench.integrators.families.{method.family}")
    with progress.compiling(f"the functions of {method.id}", system.d):
        return family.prepare(method, system, arithmetic)


_kernels: dict = {}
_FLOATS, _TABLE, _COUNTS = (
    types.Array(types.float64, 1, "C"),
    types.Array(types.float64, 2, "C"),
    types.Array(types.int64, 1, "C"),
)


def kernel(prepared: Prepared, d: int, arithmetic: str = DOUBLE) -> Callable:
    """``prepared.run``, compiled with an explicit signature (and kept on disk) unless compilation is off."""
    if arithmetic == MULTIPRECISION or not codegen.compiled():
        return prepared.run
    functions = tuple(types.none if f is None else _function_type(f) for f in prepared.functions)
    key = (prepared.run, functions, codegen.value_type(d))
    if key not in _kernels:
        _drop_stale()
        T, number = codegen.value_type(d), types.float64
        tables = (_TABLE, _TABLE, number, types.int64, number, T, _TABLE, _TABLE, _TABLE, _TABLE, _TABLE)
        signature = types.UniTuple(types.int64, 2)(*functions, *tables, _FLOATS, _COUNTS)
        family = prepared.run.__module__.rpartition(".")[2].replace("_", "-")
        with progress.compiling(f"the kernel of {family}", d), warnings.catch_warnings():
            warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
            _kernels[key] = numba.njit(signature, cache=True, **codegen.options(d))(prepared.run)
    return _kernels[key]


def _function_type(f):
    signature = f.nopython_signatures[0]
    return types.FunctionType(signature.return_type(*signature.args))


def _drop_stale() -> None:
    """Numba's cache watches only a kernel's own file; forget it when any file of the package changed."""
    folder = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted([*folder.glob("engine/*.py"), *folder.glob("families/*.py")]):
        digest.update(path.read_bytes())
    stamp = folder / "__pycache__" / "kernels.stamp"
    try:
        if stamp.exists() and stamp.read_text() == digest.hexdigest():
            return
        stamp.parent.mkdir(exist_ok=True)
        for path in [*folder.glob("engine/__pycache__/*.nb[ic]"), *folder.glob("families/__pycache__/*.nb[ic]")]:
            path.unlink(missing_ok=True)
        stamp.write_text(digest.hexdigest())
    except OSError:
        pass
