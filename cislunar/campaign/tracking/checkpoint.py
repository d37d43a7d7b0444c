"""What a run of a cell leaves on disk until it is done, so that a killed one goes on.

A folder beside the result holds one for each realization, with the pieces of its histories and, in
one file, how far it has come and by what it was made. Every file is written under a temporary name,
to the disk, and then moved into place, the state after the pieces it counts: what breaks off leaves
the last whole checkpoint.
The files are pickles, which the same sources alone can read, and nobody should take from others.
"""

import hashlib
import json
import os
import pickle
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from cislunar.campaign.data.netcdf import whole_file
from cislunar.campaign.data.progress import Progress, logger
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.tasking.closed_loop import ClosedLoop
from cislunar.tasking.recording import Piece

CHECKPOINT_S = 60.0
"""Least time between checkpoints, s: what takes less is sooner made anew than kept."""

_STATE = "state.pickle"


def checkpoint_folder(path: str | Path) -> Path:
    """Where checkpoints of a result lie."""
    path = Path(path)
    return path.with_name(f"{path.name}.checkpoint")


class Checkpoint:
    """Runs a loop, realization by realization, and keeps in a folder what it takes to go on.

    The folder appears with the first checkpoint; what comes after the last one is held in memory.
    A realization may also be run by a process of its own: whoever runs the loop then takes it from
    the folder.

    Parameters
    ----------
    folder : Path
        Only read if it is there.
    loop : ClosedLoop
        At its beginning; its realizations are taken up where checkpoints left them.
    made_by : mapping
        Provenance of the result (settings, seed, version), which checkpoints have to share.
    least_s : float
        Least time between checkpoints, s.

    Raises
    ------
    ConfigurationError
        If a checkpoint is of another run; the message names what differs.
    InputFileError
        If a checkpoint cannot be read.
    """

    def __init__(
        self,
        folder: Path,
        loop: ClosedLoop,
        made_by: Mapping[str, Any],
        *,
        least_s: float = CHECKPOINT_S,
    ) -> None:
        self._folder, self._loop, self._least_s = folder, loop, least_s
        made_by = {**made_by, "settings": json.loads(made_by.get("settings", "{}"))}
        made_by["its data sets"] = _digest(loop)
        self._parts = [
            _Part(folder / f"realization-{loop.numbers[0]:04d}", loop, made_by)
            for loop in loop.apart()
        ]

    def run(
        self,
        progress: Progress | None = None,
        *,
        pieces: int | None = None,
        realization: int | None = None,
    ) -> None:
        """Run what is left of the loop, or so many pieces of it; or one realization, and keep it.

        `progress` is called with (tasking epochs done, those of all that is to be run).
        """
        parts = self._parts if realization is None else [self._parts[realization]]
        total = sum(part.loop.lengths["epoch"] for part in parts)
        if done := sum(part.loop.state.done for part in parts):
            logger.info("going on from a checkpoint: %d of %d tasking epochs are done", done, total)
        last = time.monotonic()
        for _ in islice(_all_steps(parts, progress), pieces):
            if time.monotonic() - last >= self._least_s:
                self._save()
                last = time.monotonic()
        if realization is not None:
            self._save()
        elif pieces is None:
            self._loop.gather([part.loop for part in parts])

    def _save(self) -> None:
        for part in self._parts:
            part.save()

    def pieces(self) -> Iterator[Piece]:
        """All pieces so far, one file at a time."""
        for part in self._parts:
            yield from part.pieces()

    def remove(self) -> None:
        """The result is whole: nothing of this is needed any more."""
        shutil.rmtree(self._folder, ignore_errors=True)


class _Part:
    """A realization: its loop, its folder, and what is not yet there."""

    def __init__(self, folder: Path, loop: ClosedLoop, made_by: Mapping[str, Any]) -> None:
        self.loop, self._folder, self._made_by = loop, folder, made_by
        self._files = 0
        self._held: list[Piece] = []
        if (folder / _STATE).is_file():
            self._take_up()

    def _constants(self) -> dict[str, Any]:
        """What every realization refers to and no checkpoint holds."""
        world = self.loop.world
        return {
            "scene": world.scene,
            "surfaces": world.surfaces,
            "true surfaces": world.truth.surfaces,
        }

    def _take_up(self) -> None:
        path = self._folder / _STATE
        try:
            with path.open("rb") as file:
                made_by = pickle.load(file)
                differing = _differing(made_by, self._made_by)
                if differing is None:
                    reader = _Reader(file, self._constants())
                    self._files, self.loop.state = reader.load()
        except (OSError, EOFError, AttributeError, ImportError, pickle.UnpicklingError) as error:
            raise InputFileError(
                f"checkpoint {self._folder} cannot be read ({error}); delete it, and what it holds "
                "is made from its beginning"
            ) from error
        if differing is not None:
            key, theirs, ours = differing
            raise ConfigurationError(
                f"checkpoint {self._folder} was made with {key} = {theirs}, not {ours}: take that "
                f"back to go on with it, or delete {self._folder.parent} to make the cell from its "
                "beginning"
            )

    def steps(self, progress: Progress | None) -> Iterator[None]:
        """Go on, piece by piece."""
        for piece in self.loop.pieces(progress):
            self._held.append(piece)
            yield

    def save(self) -> None:
        """Keep what is only held."""
        if not self._held:
            return
        with _file_on_disk(self._pieces_file(self._files)) as file:
            pickle.dump(self._held, file, protocol=5)
        with _file_on_disk(self._folder / _STATE) as file:
            pickle.dump(self._made_by, file)
            _Writer(file, self._constants()).dump((self._files + 1, self.loop.state))
        self._files, self._held = self._files + 1, []

    def _pieces_file(self, number: int) -> Path:
        return self._folder / f"pieces-{number:05d}.pickle"

    def pieces(self) -> Iterator[Piece]:
        """All pieces so far, one file at a time."""
        for number in range(self._files):
            with self._pieces_file(number).open("rb") as file:
                yield from pickle.load(file)
        yield from self._held


def _all_steps(parts: Sequence[_Part], progress: Progress | None) -> Iterator[None]:
    """The steps of all realizations, one after the other, with progress over all of them."""
    before, total = 0, sum(part.loop.lengths["epoch"] for part in parts)
    for part in parts:

        def told(done: int, _: int, before: int = before) -> None:
            progress(before + done, total)

        yield from part.steps(told if progress else None)
        before += part.loop.lengths["epoch"]


class _Writer(pickle.Pickler):
    """Writes a state without what `constants` names."""

    def __init__(self, file: IO[bytes], constants: Mapping[str, Any]) -> None:
        super().__init__(file, protocol=5)
        self._names = {id(value): name for name, value in constants.items()}

    def persistent_id(self, obj: Any) -> str | None:
        return self._names.get(id(obj))


class _Reader(pickle.Unpickler):
    """Reads it, with those in place."""

    def __init__(self, file: IO[bytes], constants: Mapping[str, Any]) -> None:
        super().__init__(file)
        self._constants = constants

    def persistent_load(self, pid: str) -> Any:
        return self._constants[pid]


@contextmanager
def _file_on_disk(path: Path) -> Iterator[IO[bytes]]:
    """A file that appears once all of it is on the disk."""
    with whole_file(path) as temporary, temporary.open("wb") as file:
        yield file
        file.flush()
        os.fsync(file.fileno())


def _digest(loop: ClosedLoop) -> str:
    """A short name of all numbers a loop begins with."""
    world, found = loop.world, hashlib.sha256()
    for part in (world.scene, world.surfaces, world.truth, world.truth.surfaces, world.initial):
        for values in part:
            if isinstance(values, np.ndarray):
                found.update(np.ascontiguousarray(values).data)
    found.update(world.ids.data)
    return found.hexdigest()[:12]


def _differing(
    theirs: Mapping[str, Any], ours: Mapping[str, Any], within: str = ""
) -> tuple[str, Any, Any] | None:
    """The first key whose values differ, dotted, with both; None if all are the same."""
    for key in sorted({*theirs, *ours}):
        left, right = theirs.get(key), ours.get(key)
        if isinstance(left, Mapping) and isinstance(right, Mapping):
            found = _differing(left, right, f"{within}{key}.")
            if found is not None:
                return found
        elif left != right:
            return f"{within}{key}", left, right
    return None
