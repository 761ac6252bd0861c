"""Atomic writing of files; entries of TOML files."""

from __future__ import annotations

import os
import tempfile
import tomllib
from pathlib import Path
from typing import Any


def listed(module: str) -> dict[str, Any]:
    """The content of the TOML file beside a module, whose own file is ``module``."""
    return tomllib.loads(Path(module).with_suffix(".toml").read_text(encoding="utf-8"))


def entries(module: str, name: str = "peer") -> list[dict[str, Any]]:
    """The entries [[name]] of the TOML file beside a module, whose own file is ``module``; lists as tuples."""
    return [{k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()} for entry in listed(module)[name]]


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file atomically: to a temporary file that then replaces it, so that readers see the old or the new one.

    Raises
    ------
    OSError
        If it cannot be written; the old file stays.
    """
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        os.chmod(temporary, 0o644)  # mkstemp makes it readable by the owner only
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
