r"""A bare C loop of Stormer-Verlet for the same formula, with which the speed of compiled steps is compared.

.. math::
    p \leftarrow p - \tfrac h2 g,\quad q \leftarrow q + h\,\nabla T(p),\quad g \leftarrow \nabla V(q),\quad
    p \leftarrow p - \tfrac h2 g

One gradient a step, no compensated summation, no function pointer, no output; `gcc -O3 -march=native`.  The gradients
are the same statements as in the compiled kernels.  With merged kicks the last kick of a step and the first of the next
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

from phasebench.integrators.compile import printing
from phasebench.integrators.compile.codegen import DOUBLE


def compiler() -> str | None:
    """The path of the C compiler: $CC, gcc or cc; None if there is none."""
    for name in (os.environ.get("CC"), "gcc", "cc"):
        if name and shutil.which(name):
            return shutil.which(name)
    return None


def load_source(text: str) -> ctypes.CDLL:
    """Compile C source and load its functions; raises RuntimeError without a C compiler or if compilation fails."""
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
    """C code of the gradient of ``energy`` by ``variables`` (named ``name`` in C): (statements, components)."""
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
    """The C source of ``leapfrog(steps, h, state)``, state = (q, p); for separable H with quadratic T."""
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
    """The compiled C loop of a problem; raises RuntimeError if it cannot be compiled or T is not quadratic."""

    def __init__(self, problem, merged: bool = False):
        if not getattr(problem.system, "quadratic_kinetic", False):
            raise RuntimeError("the C loop is written for a separable H with a quadratic T")
        self.problem = problem
        self._leapfrog = load_source(source(problem.system, merged)).leapfrog
        self._leapfrog.argtypes = [ctypes.c_long, ctypes.c_double, ctypes.c_void_p]
        self._leapfrog.restype = None

    def run(self, h: float, steps: int) -> tuple[float, np.ndarray]:
        """(seconds of ``steps`` steps, the final state (q, p), array (2 d,))."""
        y = np.array([*self.problem.q0, *self.problem.p0])
        started = time.perf_counter()
        self._leapfrog(steps, h, y.ctypes.data)
        return time.perf_counter() - started, y
