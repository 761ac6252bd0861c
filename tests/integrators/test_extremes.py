"""Extreme inputs with the status and the words of the reason expected of each; no broken run is ok."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian

OSCILLATOR, PENDULUM, LOTKA = problem("harmonic-oscillator"), problem("pendulum"), problem("lotka-volterra")
KEPLER, CIRCLE = problem("kepler"), problem("kepler", e=0.0)
CLOSE, CLOSER = problem("kepler", e=0.9999), problem("kepler", e=0.999999)
BOX, CHAOTIC = problem("henon-heiles:box"), problem("henon-heiles:chaotic")
FALL = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q", singular=())  # declared without singularity
FOUND = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q")  # the same, with its singularity found in the formula
RUNAWAY = Hamiltonian(q="q", p="p", H="p**2/2 - q**4")
ROOT = Hamiltonian(q="q", p="p", H="p**2/2 + sqrt(q)")
INVALID = "invalid"


def at(q, p, **options):
    """Options of `integrate` with the initial state (q, p) of one degree of freedom."""
    return options | {"q0": [q], "p0": [p]}


ESCAPE = {"q0": [0.0, 1.2], "p0": [0.0, 0.5]}
REST = {"q0": [1.0, 0.0], "p0": [0.0, 0.0]}
#: (problem, method, options, status, words of the reason)
TABLE = [
    (OSCILLATOR, "stormer-verlet", {"h": 2.1, "t_end": 1000, "save_every": 0}, "unstable", "from t = 1000"),
    (OSCILLATOR, "stormer-verlet", {"h": 2.1, "steps": 10**6, "save_every": 0}, "diverged", "no longer finite"),
    (OSCILLATOR, "stormer-verlet", {"h": 1.99, "t_end": 1000}, "inaccurate", "comes and goes"),
    (OSCILLATOR, "stormer-verlet", {"steps": 1, "t_end": 2.8}, "inaccurate", "not the orbit"),
    (OSCILLATOR, "explicit-euler", {"h": 0.1, "t_end": 100}, "unstable", "from t = 7 on"),
    (OSCILLATOR, "implicit-euler", {"h": 0.1, "t_end": 100}, "inaccurate", "from t = 5 on"),
    (OSCILLATOR, "implicit-midpoint", {"h": 1e3, "steps": 1000}, "ok", ""),
    (PENDULUM, "implicit-midpoint", {"h": 1e3, "steps": 100}, "unstable", "not the orbit"),
    (OSCILLATOR, "scheme-i", {"h": 0.1, "steps": 1000, "parameters": {"lam": 1000}}, "unstable", "not the orbit"),
    (OSCILLATOR, "scheme-i", {"h": 0.1, "steps": 1000, "parameters": {"lam": -1000}}, "inaccurate", "not the orbit"),
    (OSCILLATOR, "stormer-verlet", {"h": -2.1, "t_end": -1000}, "unstable", "from t = -4.2"),
    (KEPLER, "stormer-verlet", {"h": 0.01, "t_end": -5} | REST, "collision", "head-on"),
    (OSCILLATOR, "stormer-verlet", at(1e150, 0.0, h=0.1, steps=100), "ok", ""),
    (OSCILLATOR, "stormer-verlet", at(1e-150, 0.0, h=0.1, steps=100), "ok", ""),
    (
        OSCILLATOR,
        "stormer-verlet",
        at(0.0, -1e-151, h=0.1, steps=100),
        INVALID,
        "choose units",
    ),
    (LOTKA, "symplectic-euler-q", at(1e-300, 1.0, h=0.01, steps=1000), "diverged", "outside H's domain"),
    (LOTKA, "explicit-euler", {"h": 1.5, "steps": 1000}, "diverged", "outside H's domain after step 0"),
    (ROOT, "stormer-verlet", at(1.0, 0.0, h=0.1, steps=100), "diverged", "after step 18"),
    (PENDULUM, "implicit-midpoint", at(pi - 1e-12, 0.0, h=0.01, steps=5000), "ok", ""),
    (CIRCLE, "scheme-iv", {"h": 0.1, "steps": 10**7, "save_every": 0}, "no-root", "of the first 1000 steps"),
    (FALL, "stormer-verlet", at(1.0, 0.0, h=0.01, t_end=10), "inaccurate", "from t = 1.12 on"),
    (FALL, "stormer-verlet", at(1.0, 0.0, h=0.01, t_end=10, save_every=0), "inaccurate", "from t = 10 on"),
    (FOUND, "stormer-verlet", at(1.0, 0.0, h=0.01, t_end=10), "collision", "head-on after t = 1.11"),
    (CLOSE, "stormer-verlet", {"h": 0.01, "t_end": 20}, "collision", "singularity"),
    (KEPLER, "stormer-verlet", {"h": 0.01, "t_end": 5} | REST, "collision", "head-on"),
    (KEPLER, "explicit-euler", {"h": 0.01, "t_end": 100, "save_every": 0}, "inaccurate", "not the orbit"),
    (CHAOTIC, "stormer-verlet", {"h": 0.01, "t_end": 100} | ESCAPE, "diverged", "the motion itself may escape"),
    (CHAOTIC, "stormer-verlet", {"h": 0.01, "t_end": 3.05} | ESCAPE, "unstable", "the motion itself may escape"),
    (RUNAWAY, "stormer-verlet", at(1.0, 1.0, h=0.01, t_end=10), "diverged", "the motion itself may escape"),
    (RUNAWAY, "implicit-midpoint", at(1.0, 1.0, h=0.01, t_end=10), "not-converged", "after step 7"),
    (PENDULUM, "scheme-i", {"h": 1e-6, "steps": 10**9, "save_every": 10**6, "timeout": 0.05}, "timeout", "reached"),
]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(("made", "method", "options", "status", "words"), TABLE)
def test_an_extreme_input_has_its_status(made, method, options, status, words):
    if status == INVALID:
        with pytest.raises(InvalidInput) as refused:
            integrate(made, method, **options)
        assert words in str(refused.value)
        return
    s = integrate(made, method, **options)
    assert (s.status, words in s.reason) == (status, True), s.reason
    assert (s.reason == "") == (words == "")
    assert np.isfinite([s.q, s.p]).all()
    assert len(s.t) == len(s.q) == len(s.p) == len(s.parameter) + 1
    assert s.t[-1] == pytest.approx(s.t[0] + s.counts["steps"] * s.h)
    if status == "timeout":
        assert s.t[-1] > 0
