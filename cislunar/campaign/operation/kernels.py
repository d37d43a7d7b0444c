"""Compiled kernels: compiled once, by one process, and dropped where their sources have changed.

Numba caches a kernel in the folder ``__pycache__`` of its module, or below ``NUMBA_CACHE_DIR``. Two
processes that call it first at the same time both compile it, and what is cached does not notice a
change in another file that it draws on. ``python -m cislunar.campaign.operation.kernels`` compiles
what searches and tracking take, or the kinds that it is given, before many jobs need it.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import cislunar
from cislunar.campaign.data.compilation import announced
from cislunar.campaign.data.progress import logger, on_terminal

_PACKAGE = Path(cislunar.__file__).parent
_IMPORTED = re.compile(r"^ *from (cislunar[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


def stamps() -> dict[Path, str]:
    """A digest for every file with kernels: of its text and of all texts that it draws on.

    These are the files of the library that it imports, directly or not, and the bodies chosen by
    type (`cislunar.compiled`), which no import shows.
    """
    texts = {path: path.read_text(encoding="utf-8") for path in _PACKAGE.rglob("*.py")}
    imports = {path: _imports(text) & texts.keys() for path, text in texts.items()}
    digests = {path: hashlib.sha256(text.encode()).digest() for path, text in texts.items()}
    chosen = [
        path for path, text in texts.items() if re.search(r"^@implements\(", text, re.MULTILINE)
    ]
    kernels = [path for path, text in texts.items() if re.search("^ *@njit", text, re.MULTILINE)]
    found = {}
    for path in sorted(kernels):
        files = sorted(_closure([path, *chosen], imports.__getitem__))
        found[path] = hashlib.sha256(b"".join(map(digests.get, files))).hexdigest()
    return found


def _imports(text: str) -> set[Path]:
    """The files that a module of the library may import."""
    found = set()
    for module, names in _IMPORTED.findall(text):
        place = _PACKAGE.parent.joinpath(*module.split("."))
        found.add(place.with_suffix(".py"))
        found.update(place / f"{name}.py" for name in re.findall(r"\w+", names))
    return found


def _closure(paths: Iterable[Path], imports: Callable[[Path], Iterable[Path]]) -> set[Path]:
    """These files and all that they import, directly or not."""
    found: set[Path] = set()
    todo = set(paths)
    while todo:
        found |= todo
        todo = {each for path in todo for each in imports(path)} - found
    return found


def drop_stale_kernels() -> list[str]:
    """Remove the cached kernels of files that, or whose imports, have changed since they were made.

    To be called before a kernel is. Returns the names of the files. A cache that cannot be written
    to is left as it is.
    """
    now = {str(path.relative_to(_PACKAGE)): stamp for path, stamp in stamps().items()}
    with contextlib.suppress(OSError), _one_at_a_time("dropping_kernels"):
        record = _common_place() / "kernels.json"
        before = json.loads(record.read_text(encoding="utf-8")) if record.is_file() else {}
        changed = [name for name, stamp in now.items() if before.get(name) != stamp]
        for name in changed:
            source = _PACKAGE / name
            for path in _cache_of(source).glob(f"{source.stem}.*.nb[ic]"):
                path.unlink(missing_ok=True)
        if changed:
            record.write_text(json.dumps(now), encoding="utf-8")
        return changed
    return []


def _cache_of(source: Path) -> Path:
    """The folder in which Numba caches the kernels of a file."""
    if not os.environ.get("NUMBA_CACHE_DIR"):
        return source.parent / "__pycache__"
    from numba.core.caching import UserProvidedCacheLocator

    place = UserProvidedCacheLocator.get_suitable_cache_subpath(str(source))
    return Path(os.environ["NUMBA_CACHE_DIR"]) / place


def _common_place() -> Path:
    """Where stamp and lock of the cache are, made where missing."""
    folder = _cache_of(_PACKAGE / "__init__.py")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextlib.contextmanager
def _one_at_a_time(what: str) -> Iterator[None]:
    """Wait, and say so, while another process does this to the same cache."""
    with open(_common_place() / f"{what}.lock", "a", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            logger.info("waiting for another process: %s", what)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def compile_kernels(of: str) -> None:
    """Compile and cache the kernels of a kind of jobs, a key of `KINDS`, or load them if cached.

    One process at a time does so for a kind; others wait, then load them. Progress goes to the
    terminal.
    """
    kind = KINDS[of]
    modules = [_PACKAGE / name for name in kind.modules]
    files = _closure(modules, lambda path: filter(Path.is_file, _imports(path.read_text())))
    with on_terminal(), contextlib.ExitStack() as held:
        with contextlib.suppress(OSError):
            held.enter_context(_one_at_a_time(f"compiling_kernels_of_{of}"))
        held.enter_context(announced({*map(str, files)}))
        kind.load()


def _track() -> None:
    """Both estimators on a problem as small as can be."""
    from cislunar.tasking.closed_loop import ClosedLoop
    from cislunar.tasking.demonstration import tracking_problem

    problem = tracking_problem(2, 3, duration_hours=2, interval_minutes=60)
    for estimator in ("mukf", "batch"):
        for _ in ClosedLoop(*problem[:4], [1], problem.loop, estimator=estimator).pieces():
            pass


def _track_among_bodies(belief: Literal["ephemeris", "cr3bp"]) -> None:
    """Both estimators, of either belief, among Earth, Moon and Sun as they are; a refined path."""
    import numpy as np

    from cislunar.campaign.settings.cell_tree import CellSettings, Dynamics
    from cislunar.campaign.tracking import real_sky
    from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.ephemeris.bodies import tabulate_bodies
    from cislunar.tasking.closed_loop import ClosedLoop
    from cislunar.tasking.demonstration import tracking_problem
    from cislunar.tasking.simulation import TruthModel

    problem = tracking_problem(2, 3, duration_hours=2, interval_minutes=60)
    dynamics = Dynamics(truth="ephemeris", filter=belief, observers="refined")
    settings = CellSettings.model_construct(dynamics=dynamics)
    sky = real_sky.Sky(tabulate_bodies(0.0, 0.1 * SECONDS_PER_DAY), 0.0, 0.0)
    observed = problem.epoch[:2], [SECONDS_PER_DAY / TIME_UNIT_S] * 2, [np.zeros(1)] * 2
    tracks = real_sky.observer_tracks(sky, dynamics, *observed, problem.loop.elapsed_s)
    scene = real_sky.real_scene(sky, tracks, problem.loop)
    placed, low_lunar = real_sky.placed_targets(sky, problem.epoch)
    surfaces, noise = problem.surfaces, problem.loop.sensor.noise
    truth = TruthModel(surfaces, noise, np.zeros(3), real_sky.true_forces(sky, dynamics))
    forces = real_sky.believed_forces(sky, settings, problem.loop, low_lunar)
    for estimator in ("mukf", "batch"):
        given = {"estimator": estimator, "truth": truth, "forces": forces}
        loop = ClosedLoop(scene, surfaces, placed, problem.ids, [1], problem.loop, **given)
        for _ in loop.pieces():
            pass


def _search() -> None:
    """Both samplers and the cost J on tables as small as can be; Hyperopt is loaded on the way."""
    import numpy as np

    from cislunar.architecture.cost import CostFunction
    from cislunar.architecture.hyperopt_search import hyperopt_search
    from cislunar.architecture.tables import ArchitectureTables

    tables = ArchitectureTables(
        observations=np.arange(12, dtype=np.uint16).reshape(3, 2, 2),
        distance=np.ones((3, 2)),
        stability_index=np.arange(1.0, 4.0),
        family=np.array(["Halo_L1_N"] * 3),
        n_steps=12,
    )
    for method in ("random", "tpe-compiled"):
        hyperopt_search(
            CostFunction(tables),
            method=method,
            rng=np.random.default_rng(0),
            n_slots=2,
            max_evaluations=25,
            early_stop=None,
        )


class Kind(NamedTuple):
    """What makes a kind of jobs load its kernels, and the modules with these."""

    load: Callable[[], None]
    modules: tuple[str, ...] = ()


_AMONG_BODIES = ("tasking/closed_loop.py", "campaign/tracking/real_sky.py")

KINDS = {
    "tracking": Kind(_track, ("tasking/closed_loop.py", "tasking/demonstration.py")),
    "tracking-ephemeris": Kind(lambda: _track_among_bodies("ephemeris"), _AMONG_BODIES),
    "tracking-cr3bp": Kind(lambda: _track_among_bodies("cr3bp"), _AMONG_BODIES),
    "search": Kind(_search, ("architecture/hyperopt_search.py", "architecture/cost.py")),
}
"""What jobs share that costs much to make ready; among real bodies by what estimators believe."""


if __name__ == "__main__":
    drop_stale_kernels()
    for each in sys.argv[1:] or ("tracking", "search"):
        compile_kernels(each)
