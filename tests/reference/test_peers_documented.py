"""What the installed packages offer and say of themselves is what the records of peers say."""

from __future__ import annotations

import importlib.metadata
import inspect
import re

import pytest

from phasebench.reference.peers import PEERS, desolver, diffrax, galpy, pyhamsys
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


def test_galpys_methods_and_orders():
    need("galpy")
    text = inspect.getdoc(galpy.load().orbit.Orbit.integrate)
    lines = {name.replace("_", "-"): words for name, words in re.findall(r"^ *- +'(\w+)' for(.*)$", text, re.MULTILINE)}
    said = {f"galpy-{name}": words for name, words in lines.items()}
    assert set(said) == {p.id for p in galpy.PEERS}
    for p in galpy.PEERS:
        if p.claims.order is not None and p.id != "galpy-dopr54-c":
            assert re.search(rf"\b{p.claims.order}(th|-th|-5-3)", said[p.id]), p.id


def test_desolvers_classes_and_claims():
    need("desolver")
    package = desolver.load().integrators
    classes = {c.__name__: c for c in package.explicit_methods() + package.implicit_methods()}
    claimed = {}
    for p in desolver.PEERS:
        name = re.match(r"desolver\.integrators\.(\w+)\.", p.claims.source)[1]
        if p.claims.order is None:  # Richardson extrapolation declares no order
            assert desolver.integrator_class(desolver.RICHARDSON + name).symplectic is p.claims.symplectic
        else:
            claimed[name] = (p.claims.order, p.claims.symplectic)
    assert claimed == {name: (c.__order__, c.symplectic) for name, c in classes.items()}


def test_pyhamsys_methods_and_orders_are_those_of_its_readme():
    need("pyhamsys")
    from pyhamsys import METHODS

    about = importlib.metadata.metadata("pyhamsys")
    readme = about.get_payload() or about["Description"]
    plain = {p.name.removeprefix("pyhamsys's "): p for p in pyhamsys.PEERS if "extended" not in p.name}
    special = {n for n in plain if not re.match(r"Yo\d", n)}
    assert {m for m in METHODS if "#" not in m} == special
    for name in special:
        line = next(line for line in readme.splitlines() if f"`{name}`" in line and "order" in line)
        numbers = re.search(r"order (\d+|\([\d,]+\))", line[line.index(f"`{name}`") :])[1]
        assert plain[name].claims.order == min(map(int, re.findall(r"\d+", numbers))), name


def test_diffrax_solvers_and_claims():
    need("diffrax")
    import diffrax as package

    classes = {n: c for n, c in vars(package).items() if inspect.isclass(c) and issubclass(c, package.AbstractSolver)}
    both = {"Euler", "Heun", "Midpoint", "Ralston", "ReversibleHeun"}  # these solve stochastic equations too
    noise = (package.AbstractItoSolver, package.AbstractStratonovichSolver, package.AbstractSRK)
    noise = (*noise, package.AbstractFosterLangevinSRK)
    expected = {n for n, c in classes.items() if "Abstract" not in n and (n in both or not issubclass(c, noise))}
    found = {re.match(r"diffrax\.(\w+)\.", p.claims.source)[1]: p for p in diffrax.PEERS}
    assert set(found) == expected - {"HalfSolver"}
    for name, p in found.items():
        assert diffrax.solver(name).order(None) == p.claims.order, name
        assert ("Symplectic method" in classes[name].__doc__) is bool(p.claims.symplectic), name


#: OpenMM states another licence than its documentation; libraries of C and C++ state none.
SILENT = ("boost", "gsl", "openmm", "sundials4py")


@pytest.mark.parametrize("package", sorted({p.package for p in PEERS} - {*SILENT}))
def test_the_license_is_that_of_the_package(package):
    need(package)
    (license,) = {p.license.split("-")[0] for p in PEERS if p.package == package}
    told = importlib.metadata.metadata(package)
    assert license in f"{told.get('License-Expression')} {told.get('License')} {told.get_all('Classifier')}"
