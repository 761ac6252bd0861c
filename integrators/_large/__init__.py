"""The kernels once more, for states that are arrays: the same sources, with reference counting (`vector.OPTIONS`).

The kernels of tuples are compiled without it: nothing they do may allocate, and no step counts references.
"""

from pathlib import Path

__path__ = [str(Path(__file__).parent.parent)]
