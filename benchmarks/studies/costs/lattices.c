/* Steps of lattices and of gravitating bodies, in doubles, without compensated sums or checks.
   Macros choose a system (FPU, TODA, KLEIN_GORDON, N_BODY, NLS) and a method (STORMER_VERLET, RK4). */
#include <math.h>

/* The gradient g of V at q or, for RK4, the field g at q, p, from constants c. */
static void slope(long d, const double *c, const double *restrict q, const double *restrict p, double *restrict g) {
#ifdef FPU
  long m = d / 2;
  double s = q[0] - q[m], left = s * s * s;
  for (long i = 0; i < m; i++) {
    s = i + 1 < m ? q[i + 1] - q[m + i + 1] - q[i] - q[m + i] : -q[i] - q[m + i];
    double right = s * s * s;
    g[i] = left - right;
    g[m + i] = c[0] * q[m + i] - left - right;
    left = right;
  }
#endif
#ifdef TODA
  double left = exp(q[d - 1] - q[0]);
  for (long i = 0; i < d; i++) {
    double right = exp(q[i] - q[i + 1 < d ? i + 1 : 0]);
    g[i] = right - left;
    left = right;
  }
#endif
#ifdef KLEIN_GORDON
  long n = d / 2;
  double a = c[0], b = c[1];
  for (long j = 0; j < n; j++) {
    long left = (j ? j : n) - 1, right = j + 1 < n ? j + 1 : 0;
    double m = 1 + 2 * a + b * (q[j] * q[j] + q[n + j] * q[n + j]);
    g[j] = m * q[j] - a * (q[left] + q[right]);
    g[n + j] = m * q[n + j] - a * (q[n + left] + q[n + right]);
  }
#endif
#ifdef N_BODY
  for (long i = 0; i < d; i++) g[i] = 0;
  for (long i = 0; i < d; i += 3)
    for (long j = i + 3; j < d; j += 3) {
      double x = q[j] - q[i], y = q[j + 1] - q[i + 1], z = q[j + 2] - q[i + 2];
      double s = x * x + y * y + z * z, a = c[0] / (s * sqrt(s));
      g[i] -= a * x; g[i + 1] -= a * y; g[i + 2] -= a * z;
      g[j] += a * x; g[j + 1] += a * y; g[j + 2] += a * z;
    }
#endif
#ifdef NLS
  double a = c[0], b = c[1];
  for (long j = 0; j < d; j++) {
    long left = (j ? j : d) - 1, right = j + 1 < d ? j + 1 : 0;
    double s = b * (q[j] * q[j] + p[j] * p[j]);
    g[j] = a * (2 * p[j] - p[left] - p[right]) - s * p[j];
    g[d + j] = s * q[j] - a * (2 * q[j] - q[left] - q[right]);
  }
#endif
}

/* n steps of q, p from q, p; work has 6 d numbers. */
#ifdef STORMER_VERLET
void steps(long d, long n, double h, const double *c, double *q, double *p, double *g) {
  slope(d, c, q, p, g);
  while (n--) {
    for (long i = 0; i < d; i++) { p[i] -= 0.5 * h * g[i]; q[i] += h * p[i]; }
    slope(d, c, q, p, g);
    for (long i = 0; i < d; i++) p[i] -= 0.5 * h * g[i];
  }
}
#endif
#ifdef RK4
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
#endif
