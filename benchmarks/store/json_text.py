"""Values of dicts, lists, texts and numbers as JSON."""

from __future__ import annotations

import json
from math import isfinite
from typing import Any


def json_text(value: Any, indent: int | None = None) -> str:
    """Write a value as JSON, with null in place of NaN and infinities, which JSON lacks; NumPy's numbers may occur."""
    return json.dumps(_finite(value), indent=indent, allow_nan=False, default=lambda x: x.item())


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(x) for key, x in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(x) for x in value]
    return None if isinstance(value, float) and not isfinite(value) else value
