"""The command line: ``python -m benchmarks``, installed as ``phasebench``; its commands are in `cli`."""

from __future__ import annotations

import sys

from phasebench.benchmarks.cli import app, main

__all__ = ["app", "main"]

if __name__ == "__main__":
    sys.exit(main())
