"""Scripts on Boost.odeint."""

import os
import subprocess
import tempfile

PROGRAM = r"""
#include <array>
#include <cmath>
#include <cstdio>
#include <boost/numeric/odeint.hpp>
using namespace boost::numeric::odeint;
typedef std::array<double, 1> half;
typedef std::array<double, 2> whole;
static void force(const half &q, const half &, half &f, double) { f[0] = 1 - std::exp(q[0]); }
static void field(const whole &x, whole &k, double) { k[0] = x[1]; k[1] = 1 - std::exp(x[0]); }
static double error(int n) {
  whole y = {{0.5, 0.3}};
  integrate_n_steps(runge_kutta_fehlberg78<whole>(), field, y, 0.0, 3.0 / 2000, 2000);
  std::pair<half, half> x(half{{0.5}}, half{{0.3}});
  integrate_n_steps(velocity_verlet<half>(), force, x, 0.0, 3.0 / n, n);
  return std::fabs(x.first[0] - y[0]);
}
int main() {
  std::printf("order measured = %.2f\n", std::log2(error(100) / error(200)));
  std::printf("order() = %d\n", (int)velocity_verlet<half>().order());
}
"""


def boost_velocity_verlet():
    """The order of velocity_verlet, measured on q'' = 1 - exp(q), beside the one it returns."""
    compiler = os.environ.get("CXX", "g++")
    with tempfile.TemporaryDirectory() as folder:
        program = f"{folder}/orders"
        subprocess.run([compiler, "-O1", "-x", "c++", "-", "-o", program], input=PROGRAM, text=True, check=True)
        printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    yield from (line.split(" = ") for line in printed.splitlines())
