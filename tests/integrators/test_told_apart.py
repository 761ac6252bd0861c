"""Machine code of functions of one name: which of them is called must not depend on what processes compiled before."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

from numba import types

from phasebench.integrators.engine import machine
from phasebench.integrators.engine.vector import TUPLES

NUMBER = types.float64(types.float64)


def times(k):
    def f(x):
        return k * x

    return f


def symbol(k, name):
    """What the linker knows the function by, without the number that counts what the process has compiled."""
    made = machine.compiled(times(k), NUMBER, TUPLES, name)
    return re.sub(r"B\dv\d+", "", next(iter(made.overloads.values())).fndesc.mangled_name)


def test_functions_of_one_line_and_of_other_content_have_other_symbols():
    assert symbol(2.0, "times|2") != symbol(3.0, "times|3")
    assert symbol(2.0, "times|2") == symbol(2.0, "times|2"), "the control"


STEPS = """
import json, sys
from phasebench.integrators.prepared import prepare
from phasebench.benchmarks.experiments.large.systems import SYSTEMS
ends = []
for name in sys.argv[1:]:
    run = prepare(SYSTEMS[name].by_hand(24), "stormer-verlet")
    ends.append(float(run(0.01, 3)[0][0]))
print(json.dumps(ends))
"""


def test_loops_that_two_processes_compiled_are_not_taken_for_one_another(tmp_path):
    """Each lattice's gradient is the same compilation of a process of its own; then one process loads both."""

    def ends(*names):
        environment = os.environ | {"PHASEBENCH_CACHE": str(tmp_path)}
        done = subprocess.run(
            [sys.executable, "-c", STEPS, *names], env=environment, capture_output=True, text=True, check=True
        )
        return json.loads(done.stdout)

    apart = ends("toda") + ends("fpu")
    assert abs(apart[0] - apart[1]) > 1e-6
    assert ends("toda", "fpu", "toda") == [*apart, apart[0]]
