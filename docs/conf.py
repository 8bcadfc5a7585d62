"""How Sphinx builds the documentation site: `./check.sh docs`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "site"))

project = "palpate"
extensions = ["myst_parser", "generated", "mathml", "touches"]
html_math_renderer = "mathml"
myst_update_mathjax = False
root_doc = "index"
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "site", "examples", "studies", "paper", "touches"]
html_theme = "furo"
html_title = "palpate"
html_show_sphinx = False
html_copy_source = False
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath", "amsmath"]
suppress_warnings = ["misc.highlighting_failure"]  # signatures of generated pages with numpy's dtypes are no Python
