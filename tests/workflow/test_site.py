"""The site: built without a warning, complete without a network, and shown by a browser."""

import ast
import html
import importlib
import inspect
import json
import pkgutil
import re
import shutil
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest
from browser import CHROMIUM, probe
from campaign_folder import ROOT, run

import cislunar

SOURCES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "config", "docs")
EXAMPLES = sorted((ROOT / "docs/examples").rglob("*.py"))
# `python -m cislunar` has no public name.
MODULES = sorted(
    each.name
    for each in pkgutil.walk_packages(cislunar.__path__, prefix="cislunar.")
    if each.name != "cislunar.__main__"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site, built from a copy of the documents; a warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            built = shutil.ignore_patterns("api", "gallery")
            shutil.copytree(ROOT / name, folder / name, ignore=built)
        else:
            shutil.copy(ROOT / name, folder)
    output, code = run("sphinx", "-W", "--keep-going", "-q", "-c", "docs", ".", "out", cwd=folder)
    assert code == 0, output[-3000:]
    return folder / "out"


class Page(HTMLParser):
    """Links of a page, the files that it loads, and its anchors."""

    def __init__(self, path):
        super().__init__()
        self.links, self.loads, self.names = [], [], set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.names |= {given.get("id"), given.get("name")}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        elif tag == "link" and "stylesheet" in given.get("rel", ""):
            self.loads.append(given["href"])
        elif tag in ("img", "script") and given.get("src"):
            self.loads.append(given["src"])


@pytest.fixture(scope="module")
def pages(site):
    """Every page of the site by its path."""
    return {path: Page(path) for path in site.rglob("*.html")}


def test_no_link_is_broken_and_nothing_is_fetched(pages):
    broken = []
    for path, page in pages.items():
        for link in page.links + page.loads:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loads and parts.scheme != "data":
                    broken.append(f"{path.name} fetches {link}")
                continue
            found = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            if not found.is_file() or (anchor and anchor not in pages[found].names):
                broken.append(f"{path.name}: {link}")
    assert not broken


def public(module):
    """Public functions and classes of a module, including compiled functions."""
    for name, value in vars(module).items():
        function = getattr(value, "py_func", value)
        kind = inspect.isfunction(function) or inspect.isclass(function)
        if kind and not name.startswith("_") and function.__module__ == module.__name__:
            yield name, function


def test_every_public_name_is_in_the_reference_with_its_docstring(pages):
    shown = set().union(*(page.names for page in pages.values()))
    for name in MODULES:
        for member, value in public(importlib.import_module(name)):
            assert f"{name}.{member}" in shown, f"{name}.{member} is not in the reference"
            assert inspect.getdoc(value), f"{name}.{member} has no docstring"


def test_sections_and_types_of_docstrings_are_rendered(site):
    text = (site / "docs/api/cislunar.dynamics.html").read_text(encoding="utf-8")
    assert "Parameters<span" in text and "ArrayLike" in text
    for page in (site / "docs/api").glob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert "_SupportsArray" not in text, page
        assert "----------" not in text, page


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_has_a_caption_and_a_plot(path, site):
    title, _, caption = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))).split(
        "\n", 2
    )
    assert len(caption.split()) > 10
    index = (site / f"docs/gallery/{path.parent.name}/index.html").read_text(encoding="utf-8")
    assert title in index
    assert [*(site / "_images").glob(f"sphx_glr_{path.stem}_001.png")]


def test_every_page_has_one_title_of_its_own(site):
    titles = {}
    for path in (site / "docs").rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        if "<article" not in text:
            continue
        assert len(re.findall(r"<h1[ >]", text)) == 1, path
        titles.setdefault(re.search(r"<title>(.*?)</title>", text, re.DOTALL)[1], []).append(path)
    assert len(titles) > 50 and not [paths for paths in titles.values() if len(paths) > 1]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_offered_as_a_notebook_and_prints_no_object(path, site, pages):
    page = site / f"docs/gallery/{path.parent.name}/{path.stem}.html"
    (notebook,) = {link for link in pages[page].links if link.endswith(".ipynb")}
    cells = json.loads((page.parent / unquote(notebook)).read_text(encoding="utf-8"))["cells"]
    assert any(cell["cell_type"] == "code" for cell in cells)
    shown = page.read_text(encoding="utf-8")
    assert not re.search(r"(Text\(|&lt;matplotlib|object at 0x)", shown)


def test_the_reference_shows_whole_summaries(site):
    page = (site / "docs/reference.html").read_text(encoding="utf-8")
    shown = " ".join(html.unescape(re.sub(r"<[^>]*>", "", page)).split())
    # the site has typographic quotation marks and dashes
    for typeset, plain in (
        ("\u2019", "'"),
        ("\u2018", "'"),
        ("\u201c", '"'),
        ("\u201d", '"'),
        ("\u2013", "--"),
        ("\u2026", "..."),
    ):
        shown = shown.replace(typeset, plain)
    for name, home in cislunar._HOMES.items():
        value = getattr(importlib.import_module(f"cislunar.{home}"), name)
        first = " ".join(inspect.getdoc(value).partition("\n\n")[0].split()).replace("`", "")
        assert first in shown, name


INSPECTION = """
if (document.readyState !== "complete") await new Promise(done => addEventListener("load", done));
if (window.MathJax && MathJax.startup) await MathJax.startup.promise;
return {
  empty: [...document.images].filter(i => i.naturalWidth === 0).map(i => i.src),
  formulas: document.querySelectorAll("mjx-container").length,
  mistakes: document.querySelectorAll("mjx-merror").length,
  wide: document.documentElement.scrollWidth - window.innerWidth,
  words: document.querySelector("article").innerText.length,
};
"""


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize(
    "name, width, formulas",
    [
        ("docs/index", 1200, 0),
        ("docs/bound", 500, 30),
        ("docs/gallery/tutorials/closed_loop", 500, 0),
        ("docs/reference", 1200, 0),
    ],
)
def test_page_opens_in_a_browser(name, width, formulas, site):
    page = site / f"{name}.html"
    found, troubles = probe(page.read_text(encoding="utf-8"), page.parent, INSPECTION, width=width)
    assert not troubles
    assert not found["empty"]
    assert found["formulas"] >= formulas
    assert found["mistakes"] == 0
    assert found["wide"] <= 0
    assert found["words"] > 500
