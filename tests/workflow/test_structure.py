"""The structure of the library: direction of imports, interfaces, private names, docstrings."""

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from inspect import getdoc, signature
from types import FunctionType

from campaign_folder import ROOT
from numba.core.dispatcher import Dispatcher

import cislunar

LIBRARY = ROOT / "cislunar"
PATHS = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(LIBRARY.rglob("*.py"))
}
PACKAGES = {name for name, path in PATHS.items() if path.name == "__init__.py"}

LAYERS = (
    "constants errors kernel_dispatcher",
    "compiled",
    "elementary parzen",
    "quantities",
    "runtime",
    "ephemeris",
    "dynamics",
    "exchange",
    "attitude orbits targets",
    "photometry",
    "observation",
    "visibility detection estimation",
    "architecture association evaluation",
    "orbit_determination",
    "tasking",
    "survey",
    "campaign.settings",
    "campaign.data",
    "campaign.architectures",
    "campaign.tracking campaign.readings",
    "campaign.survey",
    "campaign.kernels campaign.verify",
    "figures",
    "campaign.result",
    "study benchmark",
    "command",
    "__main__",
)
"""A package imports from itself and from lower layers, never from another of its own layer."""

LAYER_OF = {
    f"cislunar.{package}": number for number, line in enumerate(LAYERS) for package in line.split()
}

MOST_LINES, MOST_MODULES = 400, 13


@cache
def tree(name):
    return ast.parse(PATHS[name].read_text(encoding="utf-8"))


def docstrings(name):
    """The nodes that are docstrings, of attributes too."""
    for node in ast.walk(tree(name)):
        body = getattr(node, "body", None)
        for each in body if isinstance(body, list) else ():
            if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
                yield each.value


def imported(name, by_string=True):
    """The modules of the library that a module imports, inside functions and by string too."""
    known_docstrings = set(map(id, docstrings(name)))
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in PATHS)
        elif isinstance(node, ast.ImportFrom) and node.module in PATHS:
            for each in node.names:
                full = f"{node.module}.{each.name}"
                yield full if full in PATHS else node.module
        elif by_string and isinstance(node, ast.Constant) and id(node) not in known_docstrings:
            found = re.match(r"(cislunar(?:\.\w+)+)(?=$|:)", str(node.value))
            if found and found[1] in PATHS:
                yield found[1]


def package(name):
    """The entry of `LAYERS` that a module belongs to."""
    return max((each for each in LAYER_OF if f"{name}.".startswith(f"{each}.")), key=len)


def layered():
    return [name for name in PATHS if name not in ("cislunar", "cislunar.campaign")]


def test_imports_run_one_way():
    wrong = [
        f"{name} imports {other}"
        for name in layered()
        for other in set(imported(name)) & set(layered())
        if package(other) != package(name) and LAYER_OF[package(other)] >= LAYER_OF[package(name)]
    ]
    assert not wrong


def test_an_import_by_string_is_seen():
    # what worker and client start by name belongs to their own package
    assert "cislunar.runtime.worker" in set(imported("cislunar.runtime.worker_client"))


def test_no_module_imports_itself_by_way_of_others():
    imports = {name: set(imported(name, by_string=False)) - {name} for name in PATHS}
    TopologicalSorter(imports).prepare()


def test_other_packages_use_public_names_alone():
    wrong = []
    for name in layered():
        for node in ast.walk(tree(name)):
            if not (isinstance(node, ast.ImportFrom) and node.module in PATHS):
                continue
            for each in node.names:
                if each.name.startswith("_") and each.name != "__version__":
                    wrong.append(f"{name} imports {node.module}.{each.name}")
                if f"{node.module}.{each.name}" in PATHS or node.module in PACKAGES:
                    continue
                home = node.module.rpartition(".")[0]
                if home == "cislunar" or f"{name}.".startswith(f"{home}."):
                    continue
                # a function with the name of its module is imported from that module
                own_module = node.module.rpartition(".")[2]
                if each.name != own_module and each.name not in import_module(home).__all__:
                    wrong.append(f"{name}: {each.name} is not in __all__ of {home}")
    assert not wrong


def test_every_public_name_is_had_from_its_package():
    for name in PACKAGES - {"cislunar"}:
        module = import_module(name)
        assert all(getattr(module, each) is not None for each in module.__all__), name


def test_modules_have_one_subject():
    long = [name for name, path in PATHS.items() if len(path.read_text().splitlines()) > MOST_LINES]
    assert not long
    folders = {path.parent for path in PATHS.values()} - {LIBRARY}
    assert not [f for f in folders if len(list(f.glob("[!_]*.py"))) > MOST_MODULES]


def test_what_is_public_is_documented():
    """Arguments and results of public functions are named with shapes, units and frames."""
    wrong = []
    for name in PACKAGES - {"cislunar"}:
        module = import_module(name)
        for each in module.__all__:
            found = getattr(module, each)
            if not isinstance(found, FunctionType | Dispatcher):
                continue
            text = getattr(found, "__doc__", None) or ""
            if not text.strip():
                wrong.append(f"{name}.{each} has no docstring")
    assert not wrong


def test_help_of_top_level_names_is_complete():
    """It describes every argument, and has no term of campaigns and no private name."""
    terms = re.compile(r"\b(_[A-Za-z]\w+|[Rr]eadings? of|monitored|cells?|campaigns?|variants?)\b")
    for name in cislunar.__all__:
        found = getattr(cislunar, name)
        text = f"{signature(found)}\n{getdoc(found)}"
        assert not terms.findall(text), name
        arguments = [each for each in signature(found).parameters if each not in ("self", "values")]
        assert not [each for each in arguments if not re.search(rf"\b{each}\b.*\n +\S", text)], name
        assert "Returns\n---" in text or isinstance(found, type), name


def test_states_of_either_dynamics_do_not_claim_the_rotating_frame():
    """What also runs with ephemeris dynamics speaks of the propagation frame."""
    for name in ("observation.scene", "estimation.estimator", "dynamics.propagation"):
        text = PATHS[f"cislunar.{name}"].read_text(encoding="utf-8")
        assert "propagation frame" in text, name
