"""Configuration of the site: ``sphinx-build -c docs . build/site`` in the folder of the repository.

The pages are the Markdown files of the repository. The reference is generated from the docstrings,
and the scripts of the gallery run while the site is built. Neither the build nor the pages need a
network.
"""

import importlib
import inspect
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
    "capture_repr": (),
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
    """Write a file if its text has changed, so that Sphinx rebuilds only changed pages."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def _listed(directive, names):
    return "\n".join([directive, "", *(f"   {name}" for name in names), "", ""])


def _summaries(names):
    """A table of names, relative to the package if they have no ``~``, with the first paragraphs of
    their docstrings."""
    rows = [
        f"   * - :py:obj:`{name}`\n     - {' '.join(_summary(name.removeprefix('~')).split())}"
        for name in names
    ]
    return "\n".join([".. list-table::", "   :widths: 35 65", "", *rows, "", ""])


def _summary(name):
    """First paragraph of the docstring of a module, function or class."""
    home, _, last = name.rpartition(".")
    try:
        found = importlib.import_module(name)
    except ModuleNotFoundError:
        found = getattr(importlib.import_module(home), last)
    lines = [inspect.cleandoc(found.__doc__ or "").partition("\n\n")[0]]
    plain_bars(None, None, None, None, None, lines)
    return lines[0]


def _below(pages):
    """Pages below this one in the navigation."""
    return _listed(".. toctree::\n   :hidden:", pages)


def _interface(package):
    """The rest of the description of a package, with the names of its interface."""
    names = getattr(importlib.import_module(package), "__all__", ())
    listed = ", ".join(f"``{name}``" for name in names)
    return "   :no-members:\n\n" + (f"Interface: {listed}\n\n" if names else "")


def write_reference(app):
    """Write a page for each package with all its modules, and the lists that the index includes."""
    folder = Path(app.srcdir) / "docs/api"
    folder.mkdir(exist_ok=True)
    found = list(pkgutil.walk_packages(cislunar.__path__, "cislunar."))
    packages = [each.name for each in found if each.ispkg]
    for package in ["cislunar", *packages]:
        inside = [each for each in found if each.name.rpartition(".")[0] == package]
        modules = [each.name for each in inside if not each.ispkg and "__" not in each.name]
        below = [each.name for each in inside if each.ispkg]
        # the front page is titled by the name of the package alone
        title = package if package != "cislunar" else "Constants and top-level modules"
        text = f"{title}\n{'=' * len(title)}\n\n.. automodule:: {package}\n"
        # The modules describe the names of the interface.
        text += _interface(package) if package != "cislunar" else "\n"
        if package != "cislunar" and below + modules:
            text += _summaries([f"~{name}" for name in below + modules])
            text += _below(below)
        for name in modules:
            text += f"{name}\n{'-' * len(name)}\n\n.. automodule:: {name}\n\n"
        _written(folder / f"{package}.rst", text)
    names = [f"~cislunar.{home}.{name}" for name, home in cislunar._HOMES.items()]
    _written(folder / "names.inc", _summaries(names))
    top = [package for package in packages if package.count(".") == 1]
    pages = _below(f"api/{page}" for page in ("cislunar", *top))
    _written(folder / "packages.inc", _summaries(["cislunar.constants", *top]) + pages)


def adapt_markdown(app, docname, source):
    """Adapt links to gallery scripts and Mermaid graphs, which only GitHub shows as written."""
    if docname == "README":  # whose heading is that of the repository
        source[0] = source[0].replace("# cislunar\n", "# Start\n", 1)
    source[0] = EXAMPLE.sub(lambda m: f"(/docs/gallery/{m[1]}/{m[2] or 'index'}.rst)", source[0])
    source[0] = MERMAID.sub(_graph_as_table, source[0])


def _graph_as_table(found):
    """The arrows of a graph as a table, one row for each start."""
    leads = {}
    for start, stop in re.findall(r"^ +(\w+) --> (\w+)$", found[0], flags=re.MULTILINE):
        leads.setdefault(start, []).append(stop)
    rows = [f"| {start} | {', '.join(stops)} |" for start, stops in leads.items()]
    return "\n".join(["| rule | leads to |", "| --- | --- |", *rows, ""])


def short_signature(app, what, name, object, options, signature, returned):
    """Show array types under the names used in the source."""
    return tuple(
        text and NDARRAY.sub(r"NDArray[\1]", text.replace(ARRAY_LIKE, "ArrayLike"))
        for text in (signature, returned)
    )


def skip_fields(app, what, name, object, skip, options):
    """Skip the fields of a named tuple, which its docstring describes under Attributes."""
    return (getattr(object, "__doc__", None) or "").startswith("Alias for field") or None


def plain_bars(app, what, name, object, options, lines):
    """Escape bars in docstrings: they denote a modulus, not a substitution."""
    lines[:] = [BAR.sub(lambda m: m[1] or r"\|", line) for line in lines]


def plain_types(app, doctree):
    """Leave words in the types of docstrings, such as "shape", without a cross-reference."""
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
