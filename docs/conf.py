"""Configuration of Sphinx for the site of the project: python -m sphinx -W -b html docs build/site.

What is generated (pages of methods, problems and packages, the reports, the reference) is written into subfolders of
this folder by the extension in ``_ext`` when a build begins, and is not committed.
"""

import os
import sys
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "phasebench"
author = "The phasebench authors"
release = version = metadata.version("phasebench")

extensions = [
    "mathml",
    "myst_nb",
    "phasebench_site",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_reredirects",
    "sphinxcontrib.bibtex",
]
# Addresses of pages that are parts of others now.
_TALKS = {
    "talks-experiments": ("talk-convergence", "talk-henon-heiles", "talk-lotka-volterra", "talk-perturbed-kepler"),
    "talks": ("talk-symplectic-maps", "talks-maps", "talks-lotka-volterra"),
    "talks-schemes": ("talks-generating",),
}
redirects = {f"reports/{old}": f"{new}.html" for new, names in _TALKS.items() for old in names}
exclude_patterns = ["_build", "_ext", "_generated", "paper", "tests"]

# Pages that run are Markdown with cells; a page that has not changed is taken from the cache.
nb_execution_mode = os.environ.get("PHASEBENCH_DOCS_EXECUTE", "cache")
nb_execution_cache_path = os.environ.get("PHASEBENCH_DOCS_CACHE", str(HERE.parent / "build" / "notebooks"))
os.environ["PHASEBENCH_QUIET"] = "1"  # pages show results, not compilations
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

bibtex_bibfiles = ["../integrators/bibliography.bib", "../benchmarks/problems/bibliography.bib"]
bibtex_default_style = "plain"

# In a docstring `name` is code.
default_role = "code"
autodoc_typehints = "none"
numpydoc_show_class_members = False

html_math_renderer = "mathml"
html_theme = "pydata_sphinx_theme"
html_title = "phasebench"
html_context = {"default_mode": "auto"}
html_static_path = ["_static", "../benchmarks/page/page.js"]
html_js_files = [(name, {"defer": "defer"}) for name in ("page.js", "chooser.js")]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "navbar_align": "left",
    # Beneath a page a menu has those of its own branch alone: there are hundreds.
    "collapse_navigation": True,
    "navigation_with_keys": False,
    "show_prev_next": False,
    "secondary_sidebar_items": {"**": ["page-toc"], "index": [], "methods/index": []},
    "footer_start": ["copyright"],
    "footer_end": [],
}
# The list of methods is long, and its index sortable: pages are light without it.
bare = ("index", "start", "choose", "faq", "upgrade", "methods/**", "problems/index", "packages/**")
html_sidebars = {name: [] for name in bare}
project_copyright = "the phasebench authors, MIT licence"
