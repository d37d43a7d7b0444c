"""Warnings of estimated parameters that light curves do not determine."""

import logging

import numpy as np
import pytest

from cislunar.tasking.detection_outcomes import report_estimated_parameters

PRIOR = {"log_albedo": 0.25, "log_scale": 0.5}


@pytest.mark.parametrize(
    ("left", "rows", "message"),
    [
        ((0.3, 0.5), 100, ""),
        (
            (0.3, 0.99),
            100,
            "task2.batch.estimated_parameters: light curves do not determine log_scale: half",
        ),
        ((0.3, 0.5), 7, "8 parameters of a target (log_albedo, log_scale, and the six of its"),
        ((0.99, 0.99), 0, ""),
    ],
)
def test_undetermined_parameters_are_named(caplog, left, rows, message):
    sigma = np.ones((2, 3, 5, 2))
    sigma[:, -1] = np.array(left) * list(PRIOR.values())
    updates = np.full((2, 5), rows)
    with caplog.at_level(logging.WARNING, logger="cislunar"):
        report_estimated_parameters(sigma, PRIOR, updates, "task2.batch.estimated_parameters")
    assert (message in caplog.text) if message else not caplog.text
