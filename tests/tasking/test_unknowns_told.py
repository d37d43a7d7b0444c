"""Warnings of unknowns that light curves cannot carry."""

import logging

import numpy as np
import pytest

from cislunar.tasking.fates import report_unknowns

PRIOR = {"log_albedo": 0.25, "log_scale": 0.5}


@pytest.mark.parametrize(
    ("left", "rows", "message"),
    [
        ((0.3, 0.5), 100, ""),
        ((0.3, 0.99), 100, "task2.batch.unknowns: light curves tell nothing of log_scale: half"),
        ((0.3, 0.5), 7, "8 unknowns of a target (log_albedo, log_scale, and the six of its"),
        ((0.99, 0.99), 0, ""),
    ],
)
def test_unknowns_that_are_not_told_are_named(caplog, left, rows, message):
    sigma = np.ones((2, 3, 5, 2))
    sigma[:, -1] = np.array(left) * list(PRIOR.values())
    updates = np.full((2, 5), rows)
    with caplog.at_level(logging.WARNING, logger="cislunar"):
        report_unknowns(sigma, PRIOR, updates, "task2.batch.unknowns")
    assert (message in caplog.text) if message else not caplog.text
