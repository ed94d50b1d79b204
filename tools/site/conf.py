"""The site of `make docs`: Markdown pages by MyST, in the theme Furo."""

from __future__ import annotations

import importlib.metadata

project = "tfdb"
author = "tfdb"
version = release = importlib.metadata.version("tfdb")
extensions = ["myst_parser"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"tfdb {version}"
html_extra_path = ["_extra"]
exclude_patterns = ["_extra"]
html_copy_source = False
html_show_sphinx = False
