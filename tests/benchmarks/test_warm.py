"""Warm starts: with a filled cache an integration imports Numba and no other heavy package."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

#: On a system with d = 2, for which other tests have compiled the kernels.
METHODS = (
    "stormer-verlet",
    "scheme-v",
    "gauss-8",
    "gauss-equip-3",
    "rk4-projected-energy",
    "stormer-verlet-symmetric-projection",
)
#: End of a script: print the heavy packages imported in addition to those of Numba.
SCRIPT = """
import contextlib, io, json, sys
import numba
before = set(sys.modules)
HEAVY = ("sympy", "pandas", "matplotlib", "heyoka", "rebound")  # Numba imports SciPy's linear algebra to load code

def heavy():
    return sorted({m.partition(".")[0] for m in set(sys.modules) - before} & set(HEAVY))

found = {}
import phasebench as pb
"""
INTEGRATED = """
for method in METHODS:
    assert pb.integrate("henon-heiles", method, h=0.01, steps=5).status == "ok", method
    found[method] = heavy()
pb.integrate("kepler", "stormer-verlet", h=0.01, steps=5)
found["a singular system"] = heavy()
pb.integrate("henon-heiles:box", "stormer-verlet", h=0.01, steps=5)
found["another orbit"] = heavy()
oscillator = pb.Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2 + q**4/4")
pb.integrate(oscillator, "stormer-verlet", h=0.01, steps=5, q0=[1.0], p0=[0.0])
found["text"] = heavy()
pb.integrate_ensemble("pendulum", "stormer-verlet", [[1.0 + k / 64] for k in range(64)], [[0.0]] * 64, h=0.01, steps=5)
found["an ensemble"] = heavy()
from phasebench.benchmarks.cli import main
for words in COMMANDS:
    sys.argv = ["phasebench", "integrate", *words, "--h", "0.01", "--steps", "5"]
    printed = io.StringIO()
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(printed):
        main()
    assert "ok" in printed.getvalue(), words
    found[" ".join(words)] = heavy()
pb.integrate("nls", "implicit-midpoint", h=0.01, steps=2)  # of many variables: arrays, which compiled code allocates
print(json.dumps(found))
"""
COMMANDS = (
    ("kepler", "stormer-verlet", "--json"),
    ("stormer-verlet", "--hamiltonian", "p**2/2 + k*q**4", "--set", "k=0.25", "--q", "1", "--p", "0"),
)
MADE = """
found["before"] = heavy()
system = pb.problem("kepler", e=0.25).system if REGISTERED else pb.Hamiltonian(q="q", p="p", H="p**2/2 + q**6/7")
assert system.traits["separable"]
found["traits"] = heavy()
import numpy as np
system.energies(np.full((1, system.d), 0.5), np.zeros((1, system.d)))
found["energy"] = heavy()
system.H
found["formula"] = heavy()
print(json.dumps(found))
"""


def fresh(script: str, **environment: str) -> dict[str, list[str]]:
    """The JSON that a script prints in a fresh process."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT + script], capture_output=True, text=True, env=os.environ | environment
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_warm_integration_imports_no_heavy_package():
    script = f"METHODS, COMMANDS = {METHODS!r}, {COMMANDS!r}\n{INTEGRATED}"
    fresh(script)  # fills the cache
    found = fresh(script)
    assert {name: packages for name, packages in found.items() if packages} == {}


COMPILED = """
from phasebench.integrators.compile import machine
missed, load = [], machine._compile

def watched(f, *about):
    made = load(f, *about)
    if not sum(made.stats.cache_hits.values()):
        missed.append(f"{f.__module__}.{f.__qualname__}")
    return made

machine._compile = watched
for name, method in RUNS:
    pb.prepare(name, method)(0.001, 3)
states = [[0.1, k / 640] for k in range(64)]
pb.integrate_ensemble("henon-heiles", "rk4", states, states, h=0.01, steps=5)
pb.section("henon-heiles", "rk4", states, states, of="q1", h=0.01, steps=50)
print(json.dumps(missed))
"""
#: Values, arrays, stages in lanes, loops by hand, bodies in lanes, steps that vary, and a root in every step.
RUNS = (
    *(("henon-heiles", id) for id in ("stormer-verlet", "gauss-8", "scheme-v", "gauss-6-field", "gauss-equip-3")),
    *(("nls", id) for id in ("rk4", "implicit-midpoint")),
    *(("kepler", id) for id in ("stormer-verlet-adaptive", "wisdom-holman")),
    ("outer-solar-system", "wisdom-holman"),
)


def test_a_warm_process_compiles_nothing():
    """What Numba keeps and does not find again would be compiled by every process."""
    script = f"RUNS = {RUNS!r}\n{COMPILED}"
    fresh(script)  # compiles what other tests have not
    assert fresh(script) == []


def test_control_a_cold_process_compiles(tmp_path):
    assert fresh(f"RUNS = {RUNS[:1]!r}\n{COMPILED}", PHASEBENCH_CACHE=str(tmp_path))


@pytest.mark.parametrize("registered", [True, False])
def test_control_sympy_is_imported_when_cold_or_for_h(registered, tmp_path):
    script = f"REGISTERED = {registered}\n{MADE}"
    cold, warm = (fresh(script, PHASEBENCH_CACHE=str(tmp_path)) for _ in range(2))
    assert cold == {"before": [], "traits": ["sympy"], "energy": ["sympy"], "formula": ["sympy"]}
    assert warm == {"before": [], "traits": [], "energy": [], "formula": ["sympy"]}
