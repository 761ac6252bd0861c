"""Run a script: `python benchmarks/studies/audit/scripts NAME`.

It is a function of `of_PACKAGE.py` that yields what it measures, (name, number as text).
"""

import sys
from importlib import import_module

from shared import MARK, file_of

for name, value in getattr(import_module(file_of(sys.argv[1]).stem), sys.argv[1])():
    print(f"{MARK}{name} = {value}", flush=True)
