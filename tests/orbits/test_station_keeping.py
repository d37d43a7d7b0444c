"""The estimated cost of station keeping against a simulated flight, mode by mode."""

import numpy as np
import pytest

from cislunar.constants import LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.propagation import propagate, propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.orbits.families import observer_library
from cislunar.orbits.stability import monodromy, stability_index
from cislunar.orbits.station_keeping import station_keeping_m_s, unstable_modes

SPEED = 1e3 * LENGTH_UNIT_KM / TIME_UNIT_S
DAY = SECONDS_PER_DAY / TIME_UNIT_S


@pytest.fixture(scope="module")
def halo():
    orbits = observer_library({"Halo_L1_N": 3})
    return orbits.state[0], float(orbits.period[0])


def test_unstable_coordinates_grow_by_the_eigenvalue(halo):
    modes, growth = unstable_modes(*halo)
    largest = np.abs(np.linalg.eigvals(monodromy(*halo))).max()
    assert growth == pytest.approx(np.array([[largest]]), rel=1e-5)
    index = stability_index(*halo)
    assert 0.5 * (growth[0, 0] + 1.0 / growth[0, 0]) == pytest.approx(index, rel=1e-5)
    # one unstable coordinate at 64 points of the orbit
    assert modes.shape == (64, 1, 6)


def test_a_simulated_flight_costs_as_much_as_estimated(halo):
    """Without the linear map: two trajectories are propagated, and modes are eigenvectors."""
    state, period = halo
    steps, each = 24, 40
    sigma = np.repeat([1e-3 / LENGTH_UNIT_KM, 1e-5 / SPEED], 3)  # small, to be linear
    apart = steps * period / 64
    times = apart * np.arange(8)  # 8 maneuvers in 3 revolutions
    nominal = propagate(state, times, forces=CR3BP(), method="dop853")
    rows = []
    for each_state in nominal:
        values, vectors = np.linalg.eig(propagate_stm(each_state, period, forces=CR3BP())[1].T)
        rows.append(vectors[:, np.argmax(np.abs(values))].real)
    rng, spent, off = np.random.default_rng(5), [], np.zeros(6)
    for turn in range(each):
        for k, start in enumerate(nominal):
            row = rows[k]
            seen = off + sigma * rng.standard_normal(6)
            change = -row[3:] * (row @ seen) / (row[3:] @ row[3:])
            if turn:
                spent.append(np.sum(change**2))
            off[3:] += change
            # neutral and stable components cost nothing and are removed
            off = row * (row @ off) / (row @ row)
            both = [propagate(s, [apart], forces=CR3BP(), method="dop853")[0]
                    for s in (start, start + off)]  # fmt: skip
            off = both[1] - both[0]
    flown = np.sqrt(np.mean(spent)) * SPEED * 365.25 * DAY / apart
    given = {"position_km": 1e-3, "velocity_m_s": 1e-5}
    days = apart / DAY
    estimate = station_keeping_m_s(
        state, period, **given, least_days=days * (1 - 1e-9), most_days=days * (1 + 1e-9)
    )
    assert flown == pytest.approx(estimate, rel=0.25)
    assert station_keeping_m_s(state, period, **given) <= estimate
    # linear in the errors
    assert station_keeping_m_s(state, period) == pytest.approx(
        1e3 * station_keeping_m_s(state, period, **given), rel=1e-9
    )


def test_stable_orbits_cost_nothing_and_impossible_errors_are_named():
    steady = observer_library({"Halo_L2_S": 40})
    at = int(np.argmin(steady.stability_index))
    assert steady.stability_index[at] < 1.0 + 1e-9
    assert station_keeping_m_s(steady.state[at], steady.period[at]) == 0.0
    for wrong, said in (({"position_km": 0.0}, "position_km"), ({"least_days": -1.0}, "least_days"),
                        ({"most_days": 0.5}, "most_days = 0.5"),
                        ({"period": 0.0}, "period")):  # fmt: skip
        with pytest.raises(ConfigurationError, match=said):
            station_keeping_m_s(steady.state[at], **({"period": steady.period[at]} | wrong))
