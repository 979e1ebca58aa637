"""Settings of the documentation's site: `make docs` builds it, without the network.

Pages are Markdown, examples are the scripts of examples/gallery, and the reference comes from the code itself.
"""

from __future__ import annotations

import sys
import tomllib
from itertools import groupby
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

PROJECT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(PROJECT))

from research.messages import messages  # noqa: E402

project, author = "gs-surrogate", "The gs-surrogate developers"
version = release = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
project_copyright = author

extensions = [
    "myst_nb",  # Markdown, and the tutorial notebook with its stored outputs
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["gallery/*.ipynb", "gallery/*.md5", "gallery/*.py"]
suppress_warnings = ["config.cache", "misc.highlighting_failure"]  # Mermaid stays text
nitpicky = False

# Markdown
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"

# Reference
templates_path = ["_templates"]
autosummary_generate = True
autodoc_typehints = "none"  # signatures have them
numpydoc_show_class_members = False
default_role = "literal"  # single backticks of docstrings

# Gallery: only examples that changed are run again.
sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": "/plot_",
    "ignore_pattern": r"blobs\.py",  # what they share
    "capture_repr": ("_repr_html_",),  # pages, and not what a drawing function returns
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "remove_config_comments": True,
    "write_computation_times": False,
}

# Pages
html_theme = "pydata_sphinx_theme"
html_title = project
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {
    "navbar_align": "left",
    "show_nav_level": 1,
    "header_links_before_dropdown": 8,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_math_renderer = "mathml"
copybutton_exclude = ".linenos, .gp, .go"


def _write_math(translator: Any, node: nodes.Element, *, as_block: bool) -> None:
    """Formulas as MathML, which browsers draw by themselves: a script would come from the network."""
    translator.body.append(tex2mathml(node.astext(), as_block=as_block))
    raise nodes.SkipNode


class Messages(SphinxDirective):
    """All errors and warnings of the packages, a section for each."""

    def run(self) -> list[nodes.Node]:
        sections = []
        for package, group in groupby(messages(), key=lambda message: message.module.partition(".")[0]):
            section = nodes.section("", nodes.title(text=package), ids=[f"messages-{package}"])
            items = nodes.bullet_list()
            for message in group:
                line = nodes.paragraph("", "", nodes.literal(text=message.text))
                line += nodes.Text(f" ({message.kind}, {message.module})")
                items += nodes.list_item("", line)
            section += items
            sections.append(section)
        return sections


def setup(app: Sphinx) -> None:
    app.add_directive("messages", Messages)
    app.add_html_math_renderer(
        "mathml",
        (lambda translator, node: _write_math(translator, node, as_block=False), None),
        (lambda translator, node: _write_math(translator, node, as_block=True), None),
    )
