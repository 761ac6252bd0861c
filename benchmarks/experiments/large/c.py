"""Steps of Stormer-Verlet and of RK4 in plain C, for the Hamiltonian systems of the module `systems`.

The loops have neither compensated sums nor checks, and are compiled by `gcc -O3 -march=native`.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure.c_loop import load_source

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

FPU = """
static void slope(long d, const double *c, const double *restrict q, const double *restrict p, double *restrict g) {
  long m = d / 2;
  double s = q[0] - q[m], left = s * s * s;
  for (long i = 0; i < m; i++) {
    s = i + 1 < m ? q[i + 1] - q[m + i + 1] - q[i] - q[m + i] : -q[i] - q[m + i];
    double right = s * s * s;
    g[i] = left - right;
    g[m + i] = c[0] * q[m + i] - left - right;
    left = right;
  }
}
"""
TODA = """
static void slope(long d, const double *c, const double *restrict q, const double *restrict p, double *restrict g) {
  double left = exp(q[d - 1] - q[0]);
  for (long i = 0; i < d; i++) {
    double right = exp(q[i] - q[i + 1 < d ? i + 1 : 0]);
    g[i] = right - left;
    left = right;
  }
}
"""
KLEIN_GORDON = """
static void slope(long d, const double *c, const double *restrict q, const double *restrict p, double *restrict g) {
  long n = d / 2;
  double a = c[0], b = c[1];
  for (long j = 0; j < n; j++) {
    long left = (j ? j : n) - 1, right = j + 1 < n ? j + 1 : 0;
    double m = 1 + 2 * a + b * (q[j] * q[j] + q[n + j] * q[n + j]);
    g[j] = m * q[j] - a * (q[left] + q[right]);
    g[n + j] = m * q[n + j] - a * (q[n + left] + q[n + right]);
  }
}
"""
N_BODY = """
static void slope(long d, const double *c, const double *restrict q, const double *restrict p, double *restrict g) {
  for (long i = 0; i < d; i++) g[i] = 0;
  for (long i = 0; i < d; i += 3)
    for (long j = i + 3; j < d; j += 3) {
      double x = q[j] - q[i], y = q[j + 1] - q[i + 1], z = q[j + 2] - q[i + 2];
      double s = x * x + y * y + z * z, a = c[0] / (s * sqrt(s));
      g[i] -= a * x; g[i + 1] -= a * y; g[i + 2] -= a * z;
      g[j] += a * x; g[j + 1] += a * y; g[j + 2] += a * z;
    }
}
"""
NLS = """
static void slope(long d, const double *c, const double *restrict q, const double *restrict p, double *restrict k) {
  double a = c[0], b = c[1];
  for (long j = 0; j < d; j++) {
    long left = (j ? j : d) - 1, right = j + 1 < d ? j + 1 : 0;
    double s = b * (q[j] * q[j] + p[j] * p[j]);
    k[j] = a * (2 * p[j] - p[left] - p[right]) - s * p[j];
    k[d + j] = s * q[j] - a * (2 * q[j] - q[left] - q[right]);
  }
}
"""
#: C source of the steps: Stormer-Verlet with one gradient a step, and the classical RK4; ``work`` has 6 d numbers.
STEPS = {
    "stormer-verlet": """
void steps(long d, long n, double h, const double *c, double *q, double *p, double *work) {
  double *g = work;
  slope(d, c, q, p, g);
  while (n--) {
    for (long i = 0; i < d; i++) { p[i] -= 0.5 * h * g[i]; q[i] += h * p[i]; }
    slope(d, c, q, p, g);
    for (long i = 0; i < d; i++) p[i] -= 0.5 * h * g[i];
  }
}
""",
    "rk4": """
void steps(long d, long n, double h, const double *c, double *q, double *p, double *work) {
  double *k = work, *x = work + 2 * d, *sum = work + 4 * d;
  static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1 / 6.0, 1 / 3.0, 1 / 3.0, 1 / 6.0};
  while (n--) {
    for (long i = 0; i < 2 * d; i++) sum[i] = 0;
    for (int s = 0; s < 4; s++) {
      for (long i = 0; i < d; i++) {
        x[i] = s ? q[i] + at[s] * h * k[i] : q[i];
        x[d + i] = s ? p[i] + at[s] * h * k[d + i] : p[i];
      }
      slope(d, c, x, x + d, k);
      for (long i = 0; i < 2 * d; i++) sum[i] += weight[s] * k[i];
    }
    for (long i = 0; i < d; i++) { q[i] += h * sum[i]; p[i] += h * sum[d + i]; }
  }
}
""",
}


class Loop:
    """A C loop over the steps of a method, compiled with the C source of a system's gradient or vector field.

    ``slope`` is this source, which defines a C function `slope`; ``method`` is a key of `STEPS`.

    Raises RuntimeError without a C compiler, or if the compiler rejects the source.
    """

    def __init__(self, slope: str, method: str) -> None:
        self._steps = load_source(f"#include <math.h>\n{slope}{STEPS[method]}").steps
        self._steps.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_double, *[ctypes.c_void_p] * 4]
        self._steps.restype = None

    def run(
        self, q0: ArrayLike, p0: ArrayLike, h: float, n: int, constants: Iterable
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Take n steps of size h from q0, p0, (d,), and return (seconds, q, p) with the end state.

        ``constants`` are the numbers on which the C source of the gradient depends.
        """
        q, p, known = np.array(q0, float), np.array(p0, float), np.array([*map(float, constants), 0.0])
        work = np.zeros(6 * len(q))
        pointers = (x.ctypes.data for x in (known, q, p, work))
        started = time.perf_counter()
        self._steps(len(q), n, h, *pointers)
        return time.perf_counter() - started, q, p
