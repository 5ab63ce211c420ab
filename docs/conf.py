"""Settings of the documentation site: `python -m sphinx -W -n -b html docs out/site` builds it, without network.

Formulas are written as MathML by the writer of the reports, so that pages need neither MathJax nor fonts of their own. Pages of
theory and the gallery are made from `mb.report` and `examples/` before Sphinx reads the sources (`_ext/made.py`).
"""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]
os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])  # of the notebooks' processes
os.environ.setdefault("MPLBACKEND", "agg")

import mbdae  # noqa: E402

project, author, version, release = "mbdae", "the authors of mbdae", mbdae.__version__, mbdae.__version__
project_copyright = author
extensions = ["myst_nb", "sphinx.ext.autodoc", "formulas", "docstrings", "narrow", "made"]
exclude_patterns = ["_ext"]
nitpicky = True
smartquotes = False  # docstrings name sensors and options in straight quotes
nitpick_ignore_regex = [("py:class", r"mbdae\.\w+\..*")]  # types of attributes that are no part of the reference
html_math_renderer = "mathml"
suppress_warnings = ["mystnb.unknown_mime_type", "config.cache"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
nb_execution_show_tb = True

autodoc_typehints = "none"  # docstrings say shapes, units and frames
autodoc_member_order = "groupwise"
autodoc_default_options = {"exclude-members": "__init__, __new__"}
add_module_names = False

html_theme = "furo"
html_title = f"mbdae {release}"
html_static_path = ["_static", "img"]
html_extra_path = ["made/site"]  # the arena's folder, as it is
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"light_css_variables": {"font-stack": "system-ui, Segoe UI, Roboto, Liberation Sans, sans-serif"}}
pygments_style, pygments_dark_style = "a11y-light", "monokai"  # of 4.5 to 1 and more on the ground of code
