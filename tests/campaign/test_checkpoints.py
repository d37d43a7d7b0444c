"""An interrupted run continues from its last complete checkpoint, with the same results."""

import errno
import os

import numpy as np
import pytest

from benchmarks import scaling
from cislunar.campaign.tracking.checkpoint import Checkpoint
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.observation.sensor import Sensor
from cislunar.tasking.closed_loop import ClosedLoop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.recording import collect
from cislunar.tasking.settings import RECORDABLE

MADE_BY = {"title": "two seeds of 50 hours", "settings": '{"step_s": 600, "sensor": {"noise": 1}}'}


class Killed(Exception):
    """Raised where the run is interrupted."""


def loop_of(estimator="mukf", n_targets=3):
    problem = tracking_problem(
        2, n_targets, duration_hours=50.0, step_s=600.0, interval_minutes=120.0,
        sensor=Sensor(limiting_magnitude=25.0), record=RECORDABLE,
    )  # fmt: skip
    return ClosedLoop(*problem[:4], (3, 8), problem.loop, estimator=estimator)


def run(folder, estimator="mukf", made_by=MADE_BY, until=None, least_s=0.0):
    """Pieces and metrics, and the first epoch that was computed."""
    calls = []

    def progress(done, total):
        calls.append(done)
        if done == until:
            raise Killed

    loop = loop_of(estimator)
    checkpoint = Checkpoint(folder, loop, made_by, least_s=least_s)
    checkpoint.run(progress)
    return everything(checkpoint, loop), calls[0] if calls else None


def everything(checkpoint, loop):
    """All results of a run, by name."""
    kept, observations = collect(checkpoint.pieces(), 2, loop.lengths)
    metrics, failed, counters = loop.ends()
    return (
        kept | observations._asdict() | metrics._asdict() | {"failed": failed, "counters": counters}
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("never")
    return {name: run(folder / name, name, least_s=np.inf)[0] for name in ("mukf", "batch")}


def assert_same(found, wanted):
    assert found.keys() == wanted.keys()
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


@pytest.mark.parametrize("estimator", ["mukf", "batch"])
@pytest.mark.parametrize(("until", "again"), [(20, 13), (26, 26), (40, 38)])
def test_a_killed_run_continues_from_its_last_day(tmp_path, whole, estimator, until, again):
    """To the last bit; a seed has 25 tasking epochs, twelve a day."""
    with pytest.raises(Killed):
        run(tmp_path / "kept", estimator, until=until)
    found, first = run(tmp_path / "kept", estimator)
    assert first == again
    assert_same(found, whole[estimator])


def test_realizations_run_separately_are_read_from_disk(tmp_path, whole):
    for realization in (1, 0):
        Checkpoint(tmp_path / "kept", loop_of(), MADE_BY).run(realization=realization)
    found, first = run(tmp_path / "kept")
    assert first is None, "a realization was run again"
    assert_same(found, whole["mukf"])


def test_pieces_are_run_one_at_a_time(tmp_path, whole):
    """Six days of two realizations, each by an object of its own."""
    for number in range(1, 7):
        Checkpoint(tmp_path / "kept", loop_of(), MADE_BY, least_s=0.0).run(pieces=1)
        assert len([*tmp_path.rglob("pieces-*.pickle")]) == number
    found, first = run(tmp_path / "kept")
    assert first is None, "a day was run again"
    assert_same(found, whole["mukf"])


def test_memory_is_measured_after_every_day():
    rows = scaling._days("mukf", {"targets": 2, "observers": 2, "days": 2, "worked_through": 2})
    assert [day for day, _, _ in rows] == [1, 2]


def test_a_short_run_leaves_nothing_on_disk(tmp_path, whole):
    with pytest.raises(Killed):
        run(tmp_path / "kept", until=40, least_s=3600.0)
    assert not (tmp_path / "kept").exists()


def test_a_full_disk_leaves_the_last_complete_checkpoint(tmp_path, whole, monkeypatch):
    """The pieces of the second day fit on the disk, the state after them does not."""
    calls = []

    def full(descriptor):
        calls.append(descriptor)
        if len(calls) == 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputFileError, match=r"cannot write .*state.*No space left.*disk not full"):
        run(tmp_path / "kept")
    monkeypatch.undo()
    left = sorted(path.name for path in (tmp_path / "kept/realization-0000").iterdir())
    assert left == ["pieces-00000.pickle", "pieces-00001.pickle", "state.pickle"]
    found, first = run(tmp_path / "kept")
    assert first == 13
    assert_same(found, whole["mukf"])


def test_a_checkpoint_of_another_run_is_refused_by_name(tmp_path):
    folder = tmp_path / "kept"
    with pytest.raises(Killed):
        run(folder, until=13)
    other = {**MADE_BY, "settings": MADE_BY["settings"].replace('"noise": 1', '"noise": 2')}
    with pytest.raises(ConfigurationError, match=r"settings\.sensor\.noise = 1, not 2: .*delete"):
        run(folder, made_by=other)
    with pytest.raises(ConfigurationError, match="seed = None, not 5"):
        run(folder, made_by=MADE_BY | {"seed": 5})
    with pytest.raises(ConfigurationError, match="its data sets"):
        Checkpoint(folder, loop_of(n_targets=4), MADE_BY)
    state = folder / "realization-0000/state.pickle"
    state.write_bytes(state.read_bytes()[:-100])
    with pytest.raises(InputFileError, match="cannot be read"):
        run(folder)


def test_the_size_of_a_checkpoint_does_not_grow_with_the_run(tmp_path):
    """The filter's checkpoints after one and two days have the same size within 1 %."""
    sizes = []
    for name, until in (("one", 13), ("two", 25)):
        with pytest.raises(Killed):
            run(tmp_path / name, until=until)
        sizes.append((tmp_path / name / "realization-0000/state.pickle").stat().st_size)
    assert sizes[1] == pytest.approx(sizes[0], rel=0.01)
