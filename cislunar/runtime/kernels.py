"""Cache of compiled kernels: compiled once, by one process, and removed when their sources change.

Numba caches a kernel in the folder ``__pycache__`` of its module, or below ``NUMBA_CACHE_DIR``. Two
processes that call it first at the same time both compile it, and the cache does not notice a
change in another file that the kernel depends on. ``python -m cislunar.campaign.kernels`` compiles
the kernels of searches and tracking, or the given sets, before many jobs need them.
"""

import contextlib
import fcntl
import hashlib
import importlib
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cislunar
from cislunar.runtime.compilation import announced
from cislunar.runtime.progress import logger, on_terminal

_PACKAGE = Path(cislunar.__file__).parent
_IMPORTED = re.compile(r"^ *from (cislunar[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)
_EXPORTED = re.compile(r'"(\w+)": \[([^]]*)\]')


def stamps() -> dict[Path, str]:
    """A digest for every file with kernels: of its text and of all texts that it depends on. These
    are the files of the library that it imports, directly or not, and the implementations that are
    chosen by type (`cislunar.compiled`), which no import shows."""
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
    """Files that a module of the library may import, also by the interfaces of packages."""
    found = set()
    for module, listed in _IMPORTED.findall(text):
        place, names = _PACKAGE.parent.joinpath(*module.split(".")), re.findall(r"\w+", listed)
        found.add(place.with_suffix(".py"))
        found.update(place / f"{name}.py" for name in names)
        for own, exported in _exports(place / "__init__.py"):
            if shared := set(names) & set(re.findall(r"\w+", exported)):
                found |= _imports(f"from {module}.{own} import {', '.join(shared)}")
    return found


@cache
def _exports(interface: Path) -> list[tuple[str, str]]:
    """Modules of a package and the names that its interface takes from each."""
    return _EXPORTED.findall(interface.read_text("utf-8")) if interface.is_file() else []


def _closure(paths: Iterable[Path], imports: Callable[[Path], Iterable[Path]]) -> set[Path]:
    """These files and all that they import, directly or not."""
    found: set[Path] = set()
    todo = set(paths)
    while todo:
        found |= todo
        todo = {each for path in todo for each in imports(path)} - found
    return found


def drop_stale_kernels() -> list[str]:
    """Remove the cached kernels of files that, or whose imports, have changed; returns the file
    names. It has to be called before any kernel. A read-only cache is left as it is. The sources
    are read only if the size or the time of one of them has changed."""
    with contextlib.suppress(OSError), _one_at_a_time("dropping_kernels"):
        record = _common_place() / "kernels.json"
        before = json.loads(record.read_text(encoding="utf-8")) if record.is_file() else {}
        files = _sizes_and_times()
        if before.get("files") == files:
            return []
        now = {str(path.relative_to(_PACKAGE)): stamp for path, stamp in stamps().items()}
        old = before.get("stamps", {})
        changed = [name for name, stamp in now.items() if old.get(name) != stamp]
        for name in changed:
            source = _PACKAGE / name
            for path in _cache_of(source).glob(f"{source.stem}.*.nb[ic]"):
                path.unlink(missing_ok=True)
        record.write_text(json.dumps({"files": files, "stamps": now}), encoding="utf-8")
        return changed
    return []


def _sizes_and_times() -> str:
    """A digest of the sizes and times of modification of all files of the library."""
    digest = hashlib.sha256()
    for path in sorted(map(str, _PACKAGE.rglob("*.py"))):
        state = os.stat(path)
        digest.update(f"{path} {state.st_size} {state.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def _cache_of(source: Path) -> Path:
    """The folder in which Numba caches the kernels of a file."""
    if not os.environ.get("NUMBA_CACHE_DIR"):
        return source.parent / "__pycache__"
    from numba.core.caching import UserProvidedCacheLocator

    place = UserProvidedCacheLocator.get_suitable_cache_subpath(str(source))
    return Path(os.environ["NUMBA_CACHE_DIR"]) / place


def _common_place() -> Path:
    """The folder of stamp and lock of the cache, created if missing."""
    folder = _cache_of(_PACKAGE / "__init__.py")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextlib.contextmanager
def _one_at_a_time(task: str) -> Iterator[None]:
    """Wait, with a log message, while another process does the same task for the same cache."""
    with open(_common_place() / f"{task}.lock", "a", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            logger.info("waiting for another process: %s", task)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


class KernelSet(NamedTuple):
    """Kernels that one kind of job needs: a function that loads them, and the modules of the
    kernels."""

    load: Callable[[], None]
    modules: tuple[str, ...] = ()

    def files(self) -> set[str]:
        """Paths of the modules and of all that they import."""
        modules = [_PACKAGE / name for name in self.modules]
        found = _closure(modules, lambda path: filter(Path.is_file, _imports(path.read_text())))
        return {*map(str, found)}


def compile_kernels(of: str) -> None:
    """Compile and cache a `KernelSet`, given as ``package.module:NAME:key`` with the key of a
    mapping of that name, or load it if it is cached. One process at a time compiles a set; others
    wait and then load it. Progress is logged to the terminal."""
    module, table, key = of.split(":")
    kind = getattr(importlib.import_module(module), table)[key]
    with on_terminal(), contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            # sets of one kind, such as those of the estimators, have kernels in common
            stack.enter_context(_one_at_a_time(f"compiling_kernels_of_{key.partition('-')[0]}"))
        stack.enter_context(announced(kind.files()))
        kind.load()
