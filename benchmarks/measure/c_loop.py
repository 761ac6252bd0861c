r"""The bare C loop that a compiled step is measured against: Stormer-Verlet of the same formula, nothing else.

.. math::
    p \leftarrow p - \tfrac h2 g,\quad q \leftarrow q + h\,\nabla T(p),\quad g \leftarrow \nabla V(q),\quad
    p \leftarrow p - \tfrac h2 g

One gradient a step, no compensation, no function pointer, no rows; `gcc -O3 -march=native`.  The statements of the
gradients are those that the compiled kernels run on.  With merged kicks the last of a step and the first of the next
are one, as in the compiled kernels.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import sympy as sp

from phasebench.integrators.engine import printing
from phasebench.integrators.engine.codegen import DOUBLE


def compiler() -> str | None:
    """The C compiler's path, or None: $CC, gcc or cc."""
    for name in (os.environ.get("CC"), "gcc", "cc"):
        if name and shutil.which(name):
            return shutil.which(name)
    return None


def loaded(text: str) -> ctypes.CDLL:
    """The functions of a C text, compiled; raises RuntimeError without a C compiler or where it rejects the text."""
    cc = compiler()
    if cc is None:
        raise RuntimeError("no C compiler: install gcc or set CC")
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "loop.c", Path(folder) / "loop.so"
        source.write_text(text)
        command = [cc, "-O3", "-march=native", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{cc} failed: {done.stderr.strip()}")
        return ctypes.CDLL(str(library))


def _statements(energy: sp.Expr, name: str, variables) -> tuple[str, list[str]]:
    """C statements before the components of an energy's gradient by q or p, and the components' expressions."""
    text = printing.source("f", [(name, variables)], [[sp.diff(energy, x) for x in variables]], DOUBLE)
    lines = [line.strip() for line in text.splitlines()[1:]]
    body = [f"double {line};" for line in lines[len(variables) : -1]]
    inner = re.fullmatch(r"return value\(\((.*),\)\)", lines[-1]).group(1)
    parts, depth, start = [], 0, 0
    for i, c in enumerate(inner + ","):
        depth += (c == "(") - (c == ")")
        if c == "," and depth == 0:
            parts.append(inner[start:i].strip())
            start = i + 1
    return " ".join(body), parts


def source(system, merged: bool = False) -> str:
    """The C text of ``leapfrog(steps, h, state)``, state = q then p; for a separable H with a quadratic T."""
    of_V, forces = _statements(system.potential, "q", system.q)
    of_T, velocities = _statements(system.kinetic, "p", system.p)
    d = range(system.d)
    gradient = " ".join([of_V, *(f"g_{i} = {part};" for i, part in enumerate(forces))])
    drift = " ".join([of_T, *(f"q_{i} += h * ({v});" for i, v in enumerate(velocities))])
    declared = ", ".join(f"q_{i} = y[{i}], p_{i} = y[{i + system.d}], g_{i}" for i in d)
    half, whole, undone = (
        " ".join(f"p_{i} {sign} {part}h * g_{i};" for i in d)
        for sign, part in (("-=", "0.5 * "), ("-=", ""), ("+=", "0.5 * "))
    )
    first, last = ("", whole) if merged else (half, half)
    back = " ".join(f"y[{i}] = q_{i}; y[{i + system.d}] = p_{i};" for i in d)
    return f"""#include <math.h>
void leapfrog(long steps, double h, double *y) {{
  double {declared};
  {{ {gradient} }}
  {half if merged else ""}
  for (long n = 0; n < steps; n++) {{
    {first}
    {{ {drift} }}
    {{ {gradient} }}
    {last}
  }}
  {undone if merged else ""}
  {back}
}}
"""


class Loop:
    """The compiled loop of a problem; raises RuntimeError without a C compiler or where it rejects the source."""

    def __init__(self, problem, merged: bool = False):
        if not getattr(problem.system, "quadratic_kinetic", False):
            raise RuntimeError("the C loop is written for a separable H with a quadratic T")
        self.problem = problem
        self._leapfrog = loaded(source(problem.system, merged)).leapfrog
        self._leapfrog.argtypes = [ctypes.c_long, ctypes.c_double, ctypes.c_void_p]
        self._leapfrog.restype = None

    def run(self, h: float, steps: int) -> tuple[float, np.ndarray]:
        """(seconds of ``steps`` steps, the end state: q then p)."""
        y = np.array([*self.problem.q0, *self.problem.p0])
        started = time.perf_counter()
        self._leapfrog(steps, h, y.ctypes.data)
        return time.perf_counter() - started, y
