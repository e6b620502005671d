"""How the documentation is built: `make docs`."""

from __future__ import annotations

import importlib.metadata

project = "ndtorch"
author = "the ndtorch maintainers"
release = importlib.metadata.version("ndtorch")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "sphinx_gallery.gen_gallery"]
exclude_patterns = ["gallery/README.*", "examples"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
html_theme = "furo"
html_title = "ndtorch"
sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/[a-z].*\.py",
    "remove_config_comments": True,
    "abort_on_example_error": True,
    "min_reported_time": 1,
}
