"""Sphinx: MyST pages, one notebook that runs at the build, formulas as MathML, drawings made from the code."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "symcal"
copyright = "the symcal authors, BSD-3-Clause"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "plain_docstrings",
    "drawings",
    "house_map",
]
exclude_patterns = ["_build", "_ext", "_made/*.md"]

html_theme = "furo"
html_title = "symcal"
# nothing is fetched by a reader: no web fonts, no formula renderer
html_static_path = ["_static"]
html_css_files = ["formulas.css"]

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120

autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
python_maximum_signature_line_length = 88
suppress_warnings = ["config.cache"]

# A reference that leads nowhere is an error. Signatures also name types of other libraries, which have their own
# documentation, and types of ours that functions hand on and nobody makes: `symcal.ROOM.MODULE.Name`.
nitpicky = True
nitpick_ignore_regex = [
    (r"py:(class|obj)", r"(numpy|pathlib|collections|typing)\..*"),
    (r"py:(class|obj)", r"(tuple\[)?~?(symcal(\.\w+){2,}|str|float)"),
]
