"""Settings of Sphinx: `make docs` writes the pages of this folder, and a reference of every module, to build/docs."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

import polfuse_lab  # noqa: E402

project = "PolFuse Lab"
version = release = polfuse_lab.__version__
copyright = "the authors of PolFuse Lab"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathtext",
    "plain_docstrings",
    "reference_pages",
]
exclude_patterns = ["_build", "_ext", "Thumbs.db"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
# Types of one name in several modules are linked to one of them.
suppress_warnings = ["ref.python"]

html_theme = "alabaster"
html_theme_options = {
    "description": "Rail polarimetric SAR and a polarization camera on one scene",
    "fixed_sidebar": True,
    "page_width": "1280px",
    "code_font_size": "0.8em",
    "sidebar_width": "240px",
}
html_math_renderer = "mathtext"
html_show_sourcelink = False

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_default_options = {"members": True, "ignore-module-all": True}
napoleon_numpy_docstring = False
napoleon_use_rtype = False
