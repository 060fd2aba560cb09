"""Configuration of the documentation site; ``make docs`` builds it."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
os.environ.setdefault("MPLBACKEND", "agg")

project = "algdiff"
author = "the algdiff authors"
copyright = "the algdiff authors, MIT or Apache-2.0"  # noqa: A001 - Sphinx's name
release = version = version_of("algdiff-rs")

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_gallery.gen_gallery",
    "repository_links",
    "benchmark_tables",
    "command_line",
    "page_details",
]
exclude_patterns = ["auto_examples/*.py", "auto_examples/*.ipynb", "auto_examples/images"]
templates_path = ["_templates"]
nitpicky = False  # types in signatures name NumPy's, of which there is no inventory without a network
show_warning_types = True

# Markdown as code hosts read it: their anchors, and their blocks of formulas
myst_heading_anchors = 4
myst_fence_as_directive = ["math"]

autosummary_generate = True
autodoc_member_order = "groupwise"
autodoc_typehints = "none"
default_role = "autolink"
toc_object_entries_show_parents = "hide"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
numpydoc_xref_param_type = False
numpydoc_validation_checks = {
    *("GL01", "GL03", "GL05", "GL06", "GL07", "GL08", "GL09", "GL10"),
    *("PR02", "PR05", "PR06", "PR07", "PR09", "PR10", "RT04", "RT05", "SS01", "SS02", "SS04", "SS05", "YD01"),
}

numpydoc_validation_exclude = {"exportFilterCoefficients2Ccode"}  # whose source numpydoc cannot parse

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    "filename_pattern": r"/plot_",
    "ignore_pattern": r"^(?!plot_)",
    "abort_on_example_error": True,
    "only_warn_on_example_error": False,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,
    "matplotlib_animations": False,
    "remove_config_comments": True,
    "doc_module": ("algdiff",),
    "backreferences_dir": "auto_examples/backreferences",
    "thumbnail_size": (320, 224),
    "within_subsection_order": "FileNameSortKey",
}

html_theme = "pydata_sphinx_theme"
html_title = "algdiff"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_logo = "_static/logo.svg"
html_favicon = "_static/favicon.svg"
html_context = {"default_mode": "auto"}
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_sidebars = {"index": [], "benchmarks": []}
html_theme_options = {
    "logo": {"text": "algdiff"},
    "navbar_end": ["theme-switcher"],
    "navbar_align": "left",
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "header_links_before_dropdown": 7,
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
}
