"""Generated functions are shared between equal systems within a process; systems can be pickled and deferred."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate, method
from phasebench.integrators.compile import preparation, printing
from phasebench.integrators.stepping import kernel
from phasebench.integrators.systems import deferred

PENDULUM = {"q": "q", "p": "p", "H": "p**2/2 - cos(q)"}


def end(system):
    """End state of a short run of the system."""
    return integrate(system, "scheme-i", h=0.1, steps=5, q0=[1.0], p0=[0.2]).q[-1]


def test_equal_formulas_share_their_functions():
    one, same, other = Hamiltonian(**PENDULUM), Hamiltonian(**PENDULUM), Hamiltonian(q="q", p="p", H="p**2/2 - sin(q)")
    assert one.field() is same.field()
    assert one.grad_V() is same.grad_V()
    assert one.field() is not other.field()


def test_functions_are_not_generated_again(monkeypatch):
    end(Hamiltonian(**PENDULUM))

    def refuse(*_):
        raise AssertionError("generated again")

    monkeypatch.setattr(printing, "source", refuse)
    end(Hamiltonian(**PENDULUM))
    with pytest.raises(AssertionError, match="generated again"):
        end(Hamiltonian(q="q", p="p", H="p**2/2 - cos(q) + q**6/7919"))


def test_a_problem_is_cached_by_its_parameters():
    assert problem("kepler", e=0.2).system is problem("kepler", e=0.2).system
    assert problem("kepler", e=0.2).q0 != problem("kepler", e=0.3).q0


@pytest.mark.parametrize(
    ("name", "parameters"),
    [(n, {}) for n in ("pendulum", "kepler", "lotka-volterra", "rigid-body")] + [("nls", {}), ("fpu", {"m": 1})],
)
def test_systems_can_be_pickled(name, parameters):
    made = problem(name, **parameters)
    integrate(made, "implicit-midpoint", h=0.01, steps=1)
    again = pickle.loads(pickle.dumps(made.system))
    before, after = (
        integrate(s, "implicit-midpoint", h=0.01, steps=3, q0=made.q0, p0=made.p0) for s in (made.system, again)
    )
    assert np.array_equal(before.q, after.q)
    assert np.array_equal(before.p, after.p)


# -- deferred systems and the cache of prepared steps -----------------------------------------------------------------


def pendulum():
    """The pendulum with its formula evaluated."""
    system = Hamiltonian(**PENDULUM)
    assert system.H is not None  # evaluates a deferred formula
    return system


def shell_of(system, key="a key"):
    """A copy of a system that does not read its formula until it is needed."""
    return deferred.shell(system, key, pendulum)


def test_a_deferred_system_is_made_when_its_formula_is_needed():
    whole = pendulum()
    shell = shell_of(whole)
    assert (shell.d, shell.has_energy, shell.singularities) == (1, True, 0)
    assert "H" not in vars(shell)
    assert not hasattr(shell, "system")
    assert not hasattr(shell, "q0")
    assert "H" not in vars(shell), "asking for what no system has makes nothing"
    assert shell.H == whole.H
    assert "_recipe" not in vars(shell)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = shell.nothing


def test_a_deferred_system_has_the_values_of_its_system():
    q, p = np.array([[0.3], [1.2]]), np.array([[0.1], [-0.7]])
    made, shell = pendulum(), shell_of(pendulum())
    for name in ("energies", "scale", "speed", "rates", "distances"):
        assert np.array_equal(getattr(made, name)(q, p), getattr(shell, name)(q, p))
    assert made.traits == shell.traits
    assert made.content == shell.content


def test_a_mapping_with_known_names_computes_values_on_access():
    made = []
    named = deferred.Named(["a", "b"], lambda: made.append(1) or {"a": 3, "b": 4, "c": 5})
    assert (list(named), len(named), "c" in named, made) == (["a", "b"], 2, False, [])
    assert (named["b"], dict(named)) == (4, {"a": 3, "b": 4})
    made.clear()
    with pytest.raises(KeyError):
        named["c"]
    assert not made


@pytest.fixture
def keeping(monkeypatch):
    """Switch on the cache of what methods prepare."""
    monkeypatch.setattr(preparation, "ENABLED", True)
    yield
    preparation._read.cache_clear()


@pytest.mark.usefixtures("keeping")
@pytest.mark.parametrize("id", ["scheme-v", "gauss-8", "stormer-verlet-symmetric-projection", "gauss-equip-3"])
def test_a_prepared_step_is_read_as_it_was_written(id):
    system, record = problem("pendulum").system, method(id)
    made = kernel._prepare(record, system, "double")
    name = preparation.entry(record, system)
    preparation.write(name, made)
    preparation._read.cache_clear()
    read = preparation.read(name)
    assert read is not made
    assert read.run is made.run
    assert kernel._type(read.step) == kernel._type(made.step)
    assert str(read.step) == str(made.step)


@pytest.mark.usefixtures("keeping")
def test_a_system_made_of_symbols_has_no_entry():
    q, p = sp.symbols("q p", real=True)
    assert preparation.entry(method("scheme-i"), Hamiltonian(q=[q], p=[p], H=p**2 / 2 - sp.cos(q))) is None
