"""What the installed packages say of themselves is what the records of peers say."""

from __future__ import annotations

import importlib.metadata

import pytest

from phasebench.reference.peers import PEERS
from support.needs import need

#: Package -> (object whose docstring is read, or name of REBOUND's integrator; words in it).
WORDS = {
    "rebound": [
        ("ias15", "15th order"),
        ("ias15", "very high order, non-symplectic"),
        ("bs", "BS is not a symplectic integrator"),
        ("whfast", "symplectic [Wisdom & Holman (1991)] integrator"),
        ("leapfrog", "It is symplectic. By default it is second order"),
        ("janus", "bit-wise time-reversible high-order symplectic integrator"),
        ("janus", "Supported values: 2, 4, 6, 8, 10."),
        ("mercurius", "hybrid symplectic integrator"),
        ("trace", "(almost) time-reversible"),
    ],
    "gala": [
        ("LeapfrogIntegrator", "second-order symplectic"),
        ("LeapfrogIntegrator", "* Time-reversible"),
        ("LeapfrogIntegrator", "bounded energy errors"),
        ("Ruth4Integrator", "fourth-order symplectic"),
        ("Ruth4Integrator", "time-reversibility"),
        ("RK5Integrator", "* Fifth-order accuracy"),
        ("RK5Integrator", "Not symplectic"),
        ("DOPRI853Integrator", "5th-order accurate"),
    ],
    "scipy": [("DOP853", "order 8"), ("Radau", "Radau IIA family of order 5")],
}


def docstring(package: str, name: str) -> str:
    if package == "rebound":
        simulation = importlib.import_module("rebound").Simulation()
        simulation.integrator = name
        return simulation.integrator.__doc__
    return getattr(importlib.import_module(f"{package}.integrate"), name).__doc__


@pytest.mark.parametrize("package", WORDS)
def test_documentation_states_the_claims(package):
    need(package)
    for name, words in WORDS[package]:
        assert words in " ".join(docstring(package, name).split()), name


#: OpenMM states another licence than its documentation; libraries of C and C++ state none.
SILENT = ("boost", "gsl", "openmm", "sundials4py")


@pytest.mark.parametrize("package", sorted({p.package for p in PEERS} - {*SILENT}))
def test_the_license_is_that_of_the_package(package):
    need(package)
    (license,) = {p.license.split("-")[0] for p in PEERS if p.package == package}
    told = importlib.metadata.metadata(package)
    assert license in f"{told.get('License-Expression')} {told.get('License')} {told.get_all('Classifier')}"
