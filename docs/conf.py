"""How the documentation site is built: `make docs`. Nothing is fetched, neither then nor by its readers.

Sphinx (BSD-2) with MyST (MIT) and Furo (MIT): released every few months, Markdown that GitHub shows as well, links and
anchors checked by the build, pages that need no script or font from elsewhere. MkDocs had no release since 2024.
Formulas are Unicode text, so there is nothing to render.
"""

import gc
import sys
from functools import cache
from pathlib import Path

from sphinx.search.en import SearchEnglish

_HERE = Path(__file__).resolve().parent
# the commands' help is asked of the program itself, also where it is not installed
sys.path[:0] = [str(_HERE.parent), str(_HERE / "_ext")]

# the search index takes the stem of every word on every page, most of them the same: a seventh of the build's time
SearchEnglish.stem = cache(SearchEnglish.stem)

# trees of all pages stay until the end, and each full collection of garbage walks through them
gc.set_threshold(100_000, 50, 50)

project = "Groundstation"
author = "the Groundstation authors"
html_title = "Groundstation"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "command_help", "docstring_fields"]
# docstrings give shapes and units, which types do not
autodoc_typehints = "none"
napoleon_attr_annotations = False
autodoc_member_order = "bysource"
default_role = "code"
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["_ext"]
# headings get the anchors that GitHub gives them: the same links work in both places
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
# TOML is highlighted where it is said to be TOML; everything else is shown as it is
highlight_language = "none"
smartquotes = False

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
