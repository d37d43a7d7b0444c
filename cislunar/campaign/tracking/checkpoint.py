"""Checkpoints of a run of a cell on disk, from which an interrupted run continues.

A folder beside the result has a folder for each realization, with the pieces of its histories and,
in one file, its state and provenance. Every file is written under a temporary name, synchronized to
the disk, and then moved into place, the state after its pieces, so that an interruption leaves the
last complete checkpoint. The files are pickles: only the same sources can read them, and files of
unknown origin must not be read.
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

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.runtime import Progress, logger, whole_file
from cislunar.tasking import ClosedLoop, Piece

CHECKPOINT_S = 60.0
"""Least time between checkpoints, s; a shorter computation is repeated sooner than stored."""

_STATE = "state.pickle"


def checkpoint_folder(path: str | Path) -> Path:
    """Folder of the checkpoints of a result."""
    path = Path(path)
    return path.with_name(f"{path.name}.checkpoint")


class Checkpoint:
    """Runs a loop, realization by realization, and stores checkpoints in a folder.

    The folder is created with the first checkpoint; later pieces are kept in memory. A process of
    its own may run a realization; the process that runs the loop then reads it from the folder.

    Parameters
    ----------
    folder : Path
        Folder of the checkpoints.
    loop : ClosedLoop
        At its start; its realizations continue from their checkpoints.
    made_by : mapping
        Provenance of the result (settings, seed, version), which checkpoints have to share.
    least_s : float
        Least time between checkpoints, s.

    Raises
    ------
    ConfigurationError
        If a checkpoint is of another run; the message names the difference.
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
        self._realizations = [
            _Realization(folder / f"realization-{loop.numbers[0]:04d}", loop, made_by)
            for loop in loop.split_by_realization()
        ]

    def run(
        self,
        progress: Progress | None = None,
        *,
        pieces: int | None = None,
        realization: int | None = None,
    ) -> None:
        """Run the rest of the loop, or `pieces` pieces of it; or one realization, which is stored.

        `progress` is called with (tasking epochs done, those of all that is run).
        """
        realizations = (
            self._realizations if realization is None else [self._realizations[realization]]
        )
        total = sum(each.loop.lengths["epoch"] for each in realizations)
        if done := sum(each.loop.state.done for each in realizations):
            logger.info("going on from a checkpoint: %d of %d tasking epochs are done", done, total)
        last = time.monotonic()
        for _ in islice(_all_steps(realizations, progress), pieces):
            if time.monotonic() - last >= self._least_s:
                self._save()
                last = time.monotonic()
        if realization is not None:
            self._save()
        elif pieces is None:
            self._loop.collect_states([each.loop for each in realizations])

    def _save(self) -> None:
        for each in self._realizations:
            each.save()

    def pieces(self) -> Iterator[Piece]:
        """All pieces so far, one file at a time."""
        for each in self._realizations:
            yield from each.pieces()

    def remove(self) -> None:
        """Remove the folder after the result is complete."""
        shutil.rmtree(self._folder, ignore_errors=True)


class _Realization:
    """A realization: its loop, its folder, and its unsaved pieces."""

    def __init__(self, folder: Path, loop: ClosedLoop, made_by: Mapping[str, Any]) -> None:
        self.loop, self._folder, self._made_by = loop, folder, made_by
        self._files = 0
        self._unsaved: list[Piece] = []
        if (folder / _STATE).is_file():
            self._restore()

    def _constants(self) -> dict[str, Any]:
        """Objects to which every realization refers and which no checkpoint stores."""
        inputs = self.loop.inputs
        return {
            "scene": inputs.scene,
            "surfaces": inputs.surfaces,
            "true surfaces": inputs.truth.surfaces,
        }

    def _restore(self) -> None:
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
                f"checkpoint {self._folder} cannot be read ({error}); delete it to run the "
                "realization again from its start"
            ) from error
        if differing is not None:
            key, stored, current = differing
            raise ConfigurationError(
                f"checkpoint {self._folder} was made with {key} = {stored}, not {current}: restore "
                f"the former to continue, or delete {self._folder.parent} to run the cell again "
                "from its start"
            )

    def steps(self, progress: Progress | None) -> Iterator[None]:
        """Run on, piece by piece."""
        for piece in self.loop.pieces(progress):
            self._unsaved.append(piece)
            yield

    def save(self) -> None:
        """Store the unsaved pieces."""
        if not self._unsaved:
            return
        with _file_on_disk(self._pieces_file(self._files)) as file:
            pickle.dump(self._unsaved, file, protocol=5)
        with _file_on_disk(self._folder / _STATE) as file:
            pickle.dump(self._made_by, file)
            _Writer(file, self._constants()).dump((self._files + 1, self.loop.state))
        self._files, self._unsaved = self._files + 1, []

    def _pieces_file(self, number: int) -> Path:
        return self._folder / f"pieces-{number:05d}.pickle"

    def pieces(self) -> Iterator[Piece]:
        """All pieces so far, one file at a time."""
        for number in range(self._files):
            with self._pieces_file(number).open("rb") as file:
                yield from pickle.load(file)
        yield from self._unsaved


def _all_steps(realizations: Sequence[_Realization], progress: Progress | None) -> Iterator[None]:
    """The steps of all realizations in turn, with progress over all of them."""
    before, total = 0, sum(each.loop.lengths["epoch"] for each in realizations)
    for each in realizations:

        def report(done: int, _: int, before: int = before) -> None:
            progress(before + done, total)

        yield from each.steps(report if progress else None)
        before += each.loop.lengths["epoch"]


class _Writer(pickle.Pickler):
    """Writes a state without the objects of `constants`."""

    def __init__(self, file: IO[bytes], constants: Mapping[str, Any]) -> None:
        super().__init__(file, protocol=5)
        self._names = {id(value): name for name, value in constants.items()}

    def persistent_id(self, obj: Any) -> str | None:
        return self._names.get(id(obj))


class _Reader(pickle.Unpickler):
    """Reads a state and inserts the objects of `constants`."""

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
    """A short digest of all numbers with which a loop begins."""
    inputs, found = loop.inputs, hashlib.sha256()
    for each in (
        inputs.scene,
        inputs.surfaces,
        inputs.truth,
        inputs.truth.surfaces,
        inputs.initial,
    ):
        for values in each:
            if isinstance(values, np.ndarray):
                found.update(np.ascontiguousarray(values).data)
    found.update(inputs.ids.data)
    return found.hexdigest()[:12]


def _differing(
    stored: Mapping[str, Any], current: Mapping[str, Any], within: str = ""
) -> tuple[str, Any, Any] | None:
    """The first key whose values differ, dotted, with both values; None if all are equal."""
    for key in sorted({*stored, *current}):
        left, right = stored.get(key), current.get(key)
        if isinstance(left, Mapping) and isinstance(right, Mapping):
            found = _differing(left, right, f"{within}{key}.")
            if found is not None:
                return found
        elif left != right:
            return f"{within}{key}", left, right
    return None
