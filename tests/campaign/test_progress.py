"""Progress of long work, and the log of a job."""

import logging
import re

import pytest

from cislunar.errors import InputFileError
from cislunar.runtime import progress
from cislunar.runtime.job import job
from cislunar.runtime.progress import progress_log


class Clock:
    """A clock that the test sets."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(progress.time, "monotonic", lambda: self.now)


def test_progress_lines_come_at_intervals_with_the_time_left(monkeypatch, caplog):
    clock = Clock(monkeypatch)
    caplog.set_level(logging.INFO, "cislunar")
    report = progress_log("orbits", interval_s=5.0)
    for done in range(1, 41):
        clock.now += 2.0
        report(done, 40)
    lines = [record.getMessage() for record in caplog.records]
    # 80 s in all, a line at the first call 5 s after the one before: every third, and the last.
    assert lines[0] == "orbits: 3 of 40 (8 %), 0:06 elapsed, 1:14 left"
    assert lines[-1] == "orbits: 40 of 40 (100 %), 1:20 elapsed, 0:00 left"
    assert len(lines) == 14


def test_progress_does_not_take_the_first_item_for_the_pace(monkeypatch, caplog):
    clock = Clock(monkeypatch)
    caplog.set_level(logging.INFO, "cislunar")
    report = progress_log("orbits", interval_s=5.0)
    clock.now += 10.0  # with compilation
    for done in range(1, 21):
        report(done, 41)
        clock.now += 1.0
    assert caplog.messages[0] == "orbits: 1 of 41 (2 %), 0:10 elapsed, 6:40 left at most"
    assert caplog.messages[1] == "orbits: 6 of 41 (15 %), 0:15 elapsed, 0:35 left"


def test_compilation_is_no_part_of_the_pace(monkeypatch, caplog):
    clock = Clock(monkeypatch)
    caplog.set_level(logging.INFO, "cislunar")
    report, kernels = progress_log("epochs"), progress_log("kernels", work_s=lambda: clock.now)
    clock.now += 600.0
    progress.note_compilation(600.0)
    kernels(30, 40)
    clock.now += 6.0
    report(1, 41)
    assert caplog.messages == [
        "kernels: 30 of 40 (75 %), 10:00 elapsed, 3:20 left at most",
        "epochs: 1 of 41 (2 %), 10:06 elapsed, 4:00 left at most",
    ]


def test_progress_without_anything_done_does_not_divide_by_zero(monkeypatch, caplog):
    clock = Clock(monkeypatch)
    caplog.set_level(logging.INFO, "cislunar")
    report = progress_log("orbits", interval_s=5.0)
    clock.now += 4000.0
    report(0, 7)
    assert caplog.messages == ["orbits: 0 of 7 (0 %), 1:06:40 elapsed, unknown left"]


def test_job_logs_to_its_file_and_the_terminal(tmp_path, capfd):
    log = tmp_path / "logs" / "stage" / "job.log"
    with job([log]):
        progress.logger.info("halfway")
    assert re.search(r"halfway\n.* done in 0:00\n", log.read_text())
    assert "halfway" in capfd.readouterr().err
    assert progress.logger.handlers == []


def test_job_ends_with_the_message_of_an_expected_error(tmp_path, capfd):
    log = tmp_path / "job.log"
    with pytest.raises(SystemExit) as stopped, job([log]):
        raise InputFileError("missions.csv, row 7: no Jacobi constant")
    assert stopped.value.code == 1
    for text in (log.read_text(), capfd.readouterr().err):
        assert "error: missions.csv, row 7: no Jacobi constant" in text
        assert "Traceback" not in text
    assert progress.logger.handlers == []


def test_job_keeps_the_traceback_of_an_unexpected_error(tmp_path):
    log = tmp_path / "job.log"
    with pytest.raises(ZeroDivisionError), job([log]):
        raise ZeroDivisionError("division by zero")
    assert "ZeroDivisionError" in log.read_text()
