"""The value of a field of view against a double loop."""

import numpy as np
import pytest

from cislunar.tasking.planning.assignment import values_in_field


def by_hand(value, direction, half_field):
    out = value.copy()
    for o in range(value.shape[0]):
        for j in range(value.shape[1]):
            if not value[o, j] > 0.0:
                continue
            total = 0.0
            for k in range(value.shape[1]):
                if value[o, k] > 0.0:
                    one, other = direction[o, j], direction[o, k]
                    angle = np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)
                    total += value[o, k] if angle <= half_field[o] else 0.0
            out[o, j] = total
    return out


@pytest.mark.parametrize("seed", range(4))
def test_values_are_those_of_a_double_loop(seed):
    rng = np.random.default_rng(seed)
    n_observers, n_targets = 3, 40
    direction = rng.normal([4.0, 0.0, 0.0], 1.0, size=(n_observers, n_targets, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    value = rng.normal(1.0, 1.0, size=(n_observers, n_targets))
    value[:, 5], value[:, 7] = 0.0, -np.inf
    direction[:, 5], given = np.nan, value.copy()
    half_field = np.deg2rad([1.5, 10.0, 40.0])
    found = values_in_field(value, direction, half_field)
    np.testing.assert_allclose(found, by_hand(value, direction, half_field), rtol=1e-12)
    np.testing.assert_array_equal(value, given)
    dark = ~(value > 0.0)
    np.testing.assert_array_equal(found[dark], value[dark])
    counted = (found > value * (1.0 + 1e-9)).sum(axis=1)
    assert counted[2] > 20 and counted[0] < counted[2]


def test_a_narrow_field_counts_its_own_target_alone():
    rng = np.random.default_rng(9)
    direction = rng.normal(size=(1, 500, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    value = rng.uniform(0.5, 2.0, size=(1, 500))
    for half_field in (1e-4, 1e-6):
        found = values_in_field(value, direction, np.array([half_field]))
        np.testing.assert_allclose(found, value, rtol=1e-12)
