"""Fixtures of the states of a halo orbit and of their segment of a message."""

import numpy as np
import pytest
from halo_message import ELAPSED, HALO

from cislunar.constants import EPOCH_JD, TIME_UNIT_S
from cislunar.dynamics.propagation import propagate
from cislunar.exchange.inertial import epoch_at, inertial_covariances, inertial_states
from cislunar.exchange.oem import Segment


@pytest.fixture(scope="session")
def epoch():
    return epoch_at(EPOCH_JD)


@pytest.fixture(scope="session")
def path_of_halo():
    return propagate(HALO, ELAPSED / TIME_UNIT_S, method="dop853")


@pytest.fixture(scope="session")
def segment(epoch, path_of_halo):
    factor = np.random.default_rng(1).normal(size=(2, 6, 6)) * 1e-4
    covariance = inertial_covariances(factor @ np.swapaxes(factor, 1, 2), ELAPSED[:2], epoch)
    covariance = (covariance + np.swapaxes(covariance, 1, 2)) / 2.0
    tdb = epoch.tdb_s + ELAPSED
    state = inertial_states(path_of_halo, ELAPSED, epoch)
    return Segment("HALO 1", "2030-001A", "EARTH", tdb, state, tdb[:2], covariance)
