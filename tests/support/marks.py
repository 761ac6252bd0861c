"""Pytest marks that several test files use."""

from __future__ import annotations

import pytest

from phasebench.integrators.compile import codegen

#: Marks tests of features that only compiled code has, such as SIMD lanes.
compiled = pytest.mark.skipif(not codegen.compiled(), reason="nothing is compiled")
