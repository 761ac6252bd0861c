"""Marks of tests."""

from __future__ import annotations

import pytest

from phasebench.integrators.engine import codegen

#: Of tests of what only compiled code has, such as lanes.
compiled = pytest.mark.skipif(not codegen.compiled(), reason="nothing is compiled")
