"""Public names are imported when they are first asked for, and then are what their modules have."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest
import sympy

from phasebench.integrators.engine import lazy


def test_a_stand_in_has_what_its_package_has():
    assert lazy.sympy.Symbol is sympy.Symbol
    assert "Symbol" in vars(lazy.sympy), "the second time nothing is looked up"
    with pytest.raises(AttributeError):
        _ = lazy.sympy.no_such_name


def test_a_name_is_that_of_its_home_the_first_time_and_later(monkeypatch):
    package = ModuleType("phasebench.integrators.engine")
    package.__path__ = sys.modules[package.__name__].__path__
    monkeypatch.setitem(sys.modules, package.__name__, package)
    attribute = lazy.attributes(package.__name__, {"Lazily": "lazy"})
    assert attribute("Lazily") is lazy.Lazily
    assert vars(package)["Lazily"] is lazy.Lazily
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        attribute("other")
