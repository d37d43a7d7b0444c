"""The structure of the library: imports run one way, modules and rooms stay small."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from campaign_folder import ROOT

LIBRARY = ROOT / "cislunar"
PATHS = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(LIBRARY.rglob("*.py"))
}
FOLDERS = sorted({path.parent for path in PATHS.values()})

FLOORS = (
    "constants errors compiled elementary parzen threads",
    "ephemeris",
    "dynamics",
    "exchange",
    "attitude orbits targets",
    "photometry",
    "observation",
    "visibility estimation",
    "architecture evaluation",
    "tasking",
    "campaign.settings",
    "campaign.data",
    "campaign.architectures",
    "campaign.tracking campaign.readings",
    "campaign.claims",
    "campaign.documents",
    "campaign.operation",
    "figures",
    "command",
    "__main__",
)
"""A room imports from its own floor's room and from lower floors, never from a neighbour."""

FLOOR_OF = {
    f"cislunar.{room}": number for number, line in enumerate(FLOORS) for room in line.split()
}


def imports(name):
    """The library's own modules that a module imports, inside functions too."""
    for node in ast.walk(ast.parse(PATHS[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found = [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            found = [f"{node.module}.{each.name}" for each in node.names]
            found = [each if each in PATHS else node.module for each in found]
        else:
            continue
        yield from (each for each in found if each in PATHS)


def room(name):
    """The entry of `FLOORS` a module belongs to."""
    return max((each for each in FLOOR_OF if f"{name}.".startswith(f"{each}.")), key=len)


IN_ROOMS = [name for name in PATHS if name not in ("cislunar", "cislunar.campaign")]


@pytest.mark.parametrize("name", IN_ROOMS)
def test_imports_run_down(name):
    for other in set(imports(name)) & set(IN_ROOMS):
        same = room(other) == room(name)
        assert same or FLOOR_OF[room(other)] < FLOOR_OF[room(name)], f"{name} imports {other}"


def test_no_module_imports_itself_by_way_of_others():
    TopologicalSorter({name: set(imports(name)) - {name} for name in PATHS}).prepare()


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_modules_can_be_held_in_the_head(path: Path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_rooms_have_one_subject_and_about_a_dozen_modules(folder: Path):
    assert len(list(folder.glob("[!_]*.py"))) <= 13
    assert (
        len(ast.get_docstring(ast.parse((folder / "__init__.py").read_text())).split("\n\n")) == 1
    )
