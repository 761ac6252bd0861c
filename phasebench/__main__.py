"""The command line: ``python -m phasebench``, installed as ``phasebench``; its commands are in `benchmarks.cli`."""

from __future__ import annotations

import sys

from phasebench.benchmarks.cli import main

if __name__ == "__main__":
    sys.exit(main())
