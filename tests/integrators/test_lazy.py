"""Lazy imports: public names are imported on first access and are the objects of their modules."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest
import sympy

from phasebench.integrators.compile import lazy


def test_a_lazy_module_has_the_attributes_of_its_package():
    assert lazy.sympy.Symbol is sympy.Symbol
    assert "Symbol" in vars(lazy.sympy), "the second time nothing is looked up"
    with pytest.raises(AttributeError):
        _ = lazy.sympy.no_such_name


def test_a_lazy_name_is_looked_up_once(monkeypatch):
    package = ModuleType("phasebench.integrators.compile")
    package.__path__ = sys.modules[package.__name__].__path__
    monkeypatch.setitem(sys.modules, package.__name__, package)
    attribute = lazy.attributes(package.__name__, {"LazyModule": "lazy"})
    assert attribute("LazyModule") is lazy.LazyModule
    assert vars(package)["LazyModule"] is lazy.LazyModule
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        attribute("other")
