"""Monodromy matrices and the stability index."""

import numpy as np
import pytest

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import primary_distances
from cislunar.orbits.branches import lyapunov_seed, retrograde_seed
from cislunar.orbits.stability import farthest_state, monodromy, stability_index


def test_monodromy_is_symplectic_with_a_unit_pair(library):
    for i in range(0, 302, 29):
        matrix = monodromy(library.state[i], library.period[i])
        eigenvalues = np.linalg.eigvals(matrix)
        assert np.sort(np.abs(eigenvalues - 1.0))[1] < 1e-2
        assert np.abs(np.prod(eigenvalues) - 1.0) < 1e-5
        # Eigenvalues come in reciprocal pairs.
        largest, smallest = np.abs(eigenvalues).max(), np.abs(eigenvalues).min()
        assert largest * smallest == pytest.approx(1.0, rel=1e-5)


def test_small_lyapunov_orbit_has_the_linear_growth_rate():
    """The unstable rate of a vanishing orbit is that of its libration point over one period."""
    seed = lyapunov_seed(1, amplitude=1e-4).half
    x = 0.5 * (seed.crossing[0] + seed.end[0])
    c2 = (1 - MU) / abs(x + MU) ** 3 + MU / abs(x - 1 + MU) ** 3
    rate = np.sqrt((c2 - 2 + np.sqrt(9 * c2**2 - 8 * c2)) / 2)
    expected = np.cosh(rate * seed.period)
    assert stability_index(seed.state, seed.period) == pytest.approx(expected, rel=1e-4)


def test_orbits_close_to_the_moon_are_stable():
    half = retrograde_seed().half
    assert stability_index(half.state, half.period) == pytest.approx(1.0, abs=1e-7)


def test_start_is_the_farthest_point(library):
    dragonfly = np.flatnonzero(library.family == "Dragonfly_N")[10]
    state, period = library.state[dragonfly], library.period[dragonfly]
    far = farthest_state(state, period)
    assert min(primary_distances(far)) > 2.0 * min(primary_distances(state))
    # A halo's epoch is its apolune already: not even one digit is spent.
    halo = np.flatnonzero(library.family == "Halo_L2_N")[10]
    assert np.array_equal(
        farthest_state(library.state[halo], library.period[halo]), library.state[halo]
    )
