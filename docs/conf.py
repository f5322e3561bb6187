"""How Sphinx builds the documentation: Markdown pages by hand, the reference from the docstrings."""

from importlib import metadata

project = "stereopsis"
author = "The stereopsis developers"
copyright = "The stereopsis developers"
release = version = metadata.version("stereopsis")

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build"]
templates_path = ["_templates"]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

default_role = "py:obj"  # `match` in a docstring becomes a link where there is something to link to
autosummary_generate = True
autodoc_typehints = "none"  # the docstrings say more: shapes, dtypes, units
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

html_theme = "furo"
html_title = f"stereopsis {release}"
html_show_sphinx = False
