"""The site: ``sphinx-build -c docs . build/site``, in the folder of the repository.

Its pages are the Markdown of the repository, where it stands; the reference is made of the
docstrings, and the gallery is run while the site is made. Neither the making nor the pages need a
network.
"""

import pkgutil
import re
from pathlib import Path

import matplotlib
from numpy.typing import ArrayLike
from sphinx.addnodes import pending_xref
from sphinx.util.typing import stringify_annotation

import cislunar

matplotlib.use("agg")

project = "cislunar"
copyright = "the cislunar maintainers"
version = release = cislunar.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",
    "sphinx_gallery.gen_gallery",
]
root_doc = "docs/index"
include_patterns = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "config/README.md", "docs/**"]
exclude_patterns = [
    ".*", "build", "dist", "results*", "benchmarks", "cislunar", "profiles", "tests", "workflow",
    "docs/examples", "docs/gallery/**/*.py", "docs/gallery/**/*.ipynb",
]  # fmt: skip
default_role = "code"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autosummary_generate = False
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
napoleon_google_docstring = False
napoleon_use_ivar = True
toc_object_entries_show_parents = "hide"

sphinx_gallery_conf = {
    "examples_dirs": ["docs/examples/tutorials", "docs/examples/figures"],
    "gallery_dirs": ["docs/gallery/tutorials", "docs/gallery/figures"],
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "backreferences_dir": None,
    "show_signature": False,
    "thumbnail_size": (400, 280),
    "write_computation_times": False,
}

html_theme = "furo"
html_title = "cislunar"
html_extra_path = ["redirect"]
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False

MERMAID = re.compile(r"^```mermaid\n.*?^```\n", flags=re.MULTILINE | re.DOTALL)
ARRAY_LIKE = stringify_annotation(ArrayLike, "smart")
NDARRAY = re.compile(r"~?numpy\.ndarray\[.*?dtype\[~?(?:numpy\.)?(\w+)\]\]")
BAR = re.compile(r"(``.*?``)|\|")
EXAMPLE = re.compile(r"\((?:\.\./|docs/)examples/(\w+)/(?:(\w+)\.py)?\)")


def _written(path, text):
    """Write a file if it is another, so that only what has changed is made anew."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def _listed(directive, names):
    return "\n".join([directive, "", *(f"   {name}" for name in names), "", ""])


def _summaries(names):
    """Names with the first sentences of their docstrings."""
    return _listed(".. autosummary::", names)


def _below(pages):
    """Pages that stand in the navigation beneath this one."""
    return _listed(".. toctree::\n   :hidden:", pages)


def write_reference(app):
    """A page for each room, all its modules on it, and what the page that leads there includes."""
    folder = Path(app.srcdir) / "docs/api"
    folder.mkdir(exist_ok=True)
    found = list(pkgutil.walk_packages(cislunar.__path__, "cislunar."))
    rooms = [each.name for each in found if each.ispkg]
    for room in ["cislunar", *rooms]:
        inside = [each for each in found if each.name.rpartition(".")[0] == room]
        modules = [each.name for each in inside if not each.ispkg and "__" not in each.name]
        below = [each.name for each in inside if each.ispkg]
        text = f"{room}\n{'=' * len(room)}\n\n.. automodule:: {room}\n\n"
        if room != "cislunar" and below + modules:
            text += _summaries([name.removeprefix(f"{room}.") for name in below + modules])
            text += _below(below)
        for name in modules:
            text += f"{name}\n{'-' * len(name)}\n\n.. automodule:: {name}\n\n"
        _written(folder / f"{room}.rst", text)
    names = [f"~cislunar.{home}.{name}" for name, home in cislunar._HOMES.items()]
    _written(folder / "names.inc", _summaries(names))
    top = [room for room in rooms if room.count(".") == 1]
    pages = _below(f"api/{page}" for page in ("cislunar", *top))
    _written(folder / "rooms.inc", _summaries(["cislunar.constants", *top]) + pages)


def adapt_markdown(app, docname, source):
    """What a forge shows and the site would not: scripts of the gallery, and Mermaid's graph."""
    source[0] = EXAMPLE.sub(lambda m: f"(/docs/gallery/{m[1]}/{m[2] or 'index'}.rst)", source[0])
    source[0] = MERMAID.sub(_graph_as_table, source[0])


def _graph_as_table(found):
    """The arrows of a graph, gathered by where they start."""
    leads = {}
    for start, stop in re.findall(r"^ +(\w+) --> (\w+)$", found[0], flags=re.MULTILINE):
        leads.setdefault(start, []).append(stop)
    rows = [f"| {start} | {', '.join(stops)} |" for start, stops in leads.items()]
    return "\n".join(["| rule | leads to |", "| --- | --- |", *rows, ""])


def short_signature(app, what, name, object, options, signature, returned):
    """Array types under the names they are written with."""
    return tuple(
        text and NDARRAY.sub(r"NDArray[\1]", text.replace(ARRAY_LIKE, "ArrayLike"))
        for text in (signature, returned)
    )


def skip_fields(app, what, name, object, skip, options):
    """Fields of a named tuple, which its docstring has under Attributes."""
    return (getattr(object, "__doc__", None) or "").startswith("Alias for field") or None


def plain_bars(app, what, name, object, options, lines):
    """A bar in a docstring is that of a modulus, not the beginning of a substitution."""
    lines[:] = [BAR.sub(lambda m: m[1] or r"\|", line) for line in lines]


def plain_types(app, doctree):
    """Words of types in docstrings, such as "shape", are words, not names to be looked for."""
    for node in [*doctree.findall(pending_xref)]:
        if node.get("refspecific") and "." not in node["reftarget"]:
            node.replace_self(node.children)


def setup(app):
    app.connect("builder-inited", write_reference, priority=100)
    app.connect("source-read", adapt_markdown)
    app.connect("autodoc-skip-member", skip_fields)
    app.connect("autodoc-process-signature", short_signature)
    app.connect("autodoc-process-docstring", plain_bars)
    app.connect("doctree-read", plain_types)
