"""Sphinx configuration. Build with `sphinx-build -W docs docs/_build`."""

import sys
from importlib.metadata import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "mintime"
author = "The mintime authors"
_distribution = metadata("mintime")
version = release = _distribution["Version"]
# The addresses are those of [project.urls]; there are none before the release.
_addresses = dict(url.split(", ", 1) for url in _distribution.get_all("Project-URL") or ())
html_baseurl = _addresses.get("Documentation", "")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "generated",
    "found",
]
# The gallery writes a page and a notebook of each example; the page is the one that is read.
exclude_patterns = ["_build", "examples", "gallery", "examples-gallery/*.ipynb"]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

# The notebook runs anew in each build, in a folder of its own; an error in it is one of the build.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True

autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_custom_sections = [("Columns", "params_style")]  # of a DataFrame

suppress_warnings = ["misc.highlighting_failure"]  # blocks of several files and of output

copybutton_prompt_text = "$ "

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples-gallery",
    "filename_pattern": r"plot_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "reset_modules": ("matplotlib", "generated.with_colours"),
    "show_memory": False,
    "min_reported_time": 3600,
}

html_search_scorer = str(Path(__file__).parent / "_static" / "scorer.js")
html_theme = "pydata_sphinx_theme"
html_title = "mintime"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["sort.js", "scroll.js"]
# Pages that have no others below them, or hundreds beside them: no "Section Navigation".
_ALONE = "start results problems/* claims/* planners/*"
html_sidebars = {page: [] for page in _ALONE.split()}
html_show_sourcelink = True  # a page's own text, offline
html_theme_options = {
    "show_nav_level": 1,
    "navigation_with_keys": False,
    "icon_links": [
        {"name": name, "url": url, "icon": "fa-brands fa-github"}
        for name, url in _addresses.items()
        if name in ("Repository", "Source")
    ],
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc", "sourcelink"],
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
}
