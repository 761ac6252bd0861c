"""Warm starts: with a filled cache an integration compiles nothing and imports Numba and no other heavy package."""

from __future__ import annotations

import json
import os
import subprocess
import sys

#: Values, stages in lanes, bodies in lanes, steps that vary, and a root in every step; arrays come last.
RUNS = (
    *(("henon-heiles", id) for id in ("stormer-verlet", "gauss-8", "scheme-v", "gauss-6-field", "gauss-equip-3")),
    *(("henon-heiles", id) for id in ("rk4-projected-energy", "stormer-verlet-symmetric-projection")),
    *(("kepler", id) for id in ("stormer-verlet-adaptive", "wisdom-holman")),
    ("outer-solar-system", "wisdom-holman"),
)
COMMANDS = (
    ("kepler", "stormer-verlet", "--json"),
    ("stormer-verlet", "--hamiltonian", "p**2/2 + k*q**4", "--set", "k=0.25", "--q", "1", "--p", "0"),
)
#: Begin of a script: the heavy packages imported in addition to those of Numba, and what it compiles.
SCRIPT = """
import contextlib, io, json, sys
import numba
before = set(sys.modules)
HEAVY = ("sympy", "pandas", "matplotlib", "heyoka", "rebound")  # Numba imports SciPy's linear algebra to load code

def heavy():
    return sorted({m.partition(".")[0] for m in set(sys.modules) - before} & set(HEAVY))

found = {}
import phasebench as pb
from phasebench.integrators.compile import machine
missed, load = [], machine._compile

def watched(f, *about):
    made = load(f, *about)
    if not sum(made.stats.cache_hits.values()):
        missed.append(f"{f.__module__}.{f.__qualname__}")
    return made

machine._compile = watched
"""
INTEGRATED = """
for name, method in RUNS:
    assert pb.integrate(name, method, h=0.001, steps=3).status == "ok", method
    found[f"{method} on {name}"] = heavy()
oscillator = pb.Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2 + q**4/4")
pb.integrate(oscillator, "stormer-verlet", h=0.01, steps=5, q0=[1.0], p0=[0.0])
found["text"] = heavy()
states = [[0.1, k / 640] for k in range(64)]
pb.integrate_ensemble("henon-heiles", "rk4", states, states, h=0.01, steps=5)
found["an ensemble"] = heavy()
from phasebench.benchmarks.cli import main
for words in COMMANDS:
    sys.argv = ["phasebench", "integrate", *words, "--h", "0.01", "--steps", "5"]
    printed = io.StringIO()
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(printed):
        main()
    assert "ok" in printed.getvalue(), words
    found[" ".join(words)] = heavy()
pb.section("henon-heiles", "rk4", states, states, of="q1", h=0.01, steps=50)
for method in ("rk4", "implicit-midpoint"):
    pb.integrate("nls", method, h=0.01, steps=2)  # of many variables: arrays, which compiled code allocates
print(json.dumps({"missed": missed, **{name: packages for name, packages in found.items() if packages}}))
"""
MADE = """
found["before"] = heavy()
system = pb.problem("kepler", e=0.25).system
assert system.traits["separable"]
found["traits"] = heavy()
import numpy as np
system.energies(np.full((1, system.d), 0.5), np.zeros((1, system.d)))
found["energy"] = heavy()
system.H
found["formula"] = heavy()
pb.prepare("kepler", "stormer-verlet")(0.001, 3)
print(json.dumps({"missed": bool(missed), **found}))
"""


def fresh(script: str, **environment: str) -> dict:
    """The JSON that a script prints in a fresh process."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT + script], capture_output=True, text=True, env=os.environ | environment
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_warm_integration_compiles_nothing_and_imports_no_heavy_package():
    script = f"RUNS, COMMANDS = {RUNS!r}, {COMMANDS!r}\n{INTEGRATED}"
    fresh(script)  # fills the cache
    assert fresh(script) == {"missed": []}


def test_control_a_cold_process_compiles_and_imports_sympy(tmp_path):
    cold, warm = (fresh(MADE, PHASEBENCH_CACHE=str(tmp_path)) for _ in range(2))
    assert cold == {"missed": True, "before": [], "traits": ["sympy"], "energy": ["sympy"], "formula": ["sympy"]}
    assert warm == {"missed": False, "before": [], "traits": [], "energy": [], "formula": ["sympy"]}
