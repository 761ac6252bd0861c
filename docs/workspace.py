"""Set up a page of the site that runs code: a temporary folder to write in, plain terminal output, small figures.

Every such page runs this file first.
"""

import os
import shutil
import sys
import tempfile
from pathlib import Path

import matplotlib
import pandas
from cycler import cycler
from matplotlib_inline.config import InlineBackend

from phasebench.benchmarks import style

REPOSITORY = Path(__file__).resolve().parents[1]

os.environ |= {"NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "100", "PYTHONWARNINGS": "ignore"}
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
os.chdir(tempfile.mkdtemp(prefix="phasebench-page-"))
for name in ("leapfrog.py", "mislabelled_order.py", "truncated_coefficients.py", "planets.csv", "elsewhere.csv"):
    shutil.copy(REPOSITORY / "examples" / name, name)

colours, lines, _ = zip(*style.CURVES, strict=True)
CYCLE = cycler(color=colours, linestyle=lines)
matplotlib.rcParams.update(
    style.RC | {"axes.prop_cycle": CYCLE, "figure.figsize": (6.0, 3.0), "figure.constrained_layout.use": True}
)
InlineBackend.instance().rc = {}
InlineBackend.instance().print_figure_kwargs = {"bbox_inches": None, "dpi": style.DPI}
pandas.set_option("display.width", 100, "display.max_columns", 12, "display.float_format", "{:.3g}".format)
