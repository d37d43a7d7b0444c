"""Cells with Earth, Moon and Sun from the DE421 ephemeris."""

import numpy as np
import pytest
import spiceypy
import xarray as xr
from campaign_folder import ROOT, read_campaign
from small_cells import cell_inputs, settings_of_cell

from cislunar.campaign.architectures.visibility import architecture_coverage, visibility_dataset
from cislunar.campaign.data import refined_orbits
from cislunar.campaign.data.inputs import body_table
from cislunar.campaign.data.refined_orbits import (
    forces_on_observers,
    observer_states,
    paths_dataset,
    refined_dataset,
    refined_rows,
)
from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cell_tree import CellSettings, Dynamics
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.settings.checks import check_campaign
from cislunar.campaign.settings.families import with_families
from cislunar.campaign.settings.library import loop_settings
from cislunar.campaign.settings.reading import checked, merged, typed
from cislunar.campaign.settings.scenarios import in_study, scenario_settings
from cislunar.campaign.tracking import ephemeris_inputs
from cislunar.campaign.tracking.cell import cell_problem
from cislunar.campaign.tracking.dataset import cell_dataset
from cislunar.campaign.tracking.ephemeris_inputs import flown_dataset, flown_paths
from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, MU
from cislunar.dynamics.ephemeris import UNITS, propagate_utc
from cislunar.dynamics.frames import from_inertial, pulsating_frame
from cislunar.dynamics.propagation import propagate_periodic
from cislunar.ephemeris.kernel import EARTH_MOON_BARYCENTER, kernel_path, loaded
from cislunar.errors import ConfigurationError, ConvergenceError
from cislunar.observation.sightline import sunlit_share
from cislunar.orbits.ephemeris_refined.refinement import RefinedPath, path_states
from cislunar.photometry.sphere import phase_angle, sphere_magnitude
from cislunar.runtime.netcdf import read_dataset, write_dataset

REAL = {"truth": "ephemeris", "filter": "ephemeris"}
REFINED = REAL | {"observers": "refined"}
CELL = Cell("A", "tpe", "mukf", 3, 60)


@pytest.fixture(scope="module")
def inputs():
    return cell_inputs(duration_days=3, bodies=True)


def settings_of(**changes):
    return settings_of_cell({"seeds": 1, "record": ["truth"]}, **{"dynamics": REAL, **changes})


def test_bodies_agree_with_spice_and_observers_with_the_frames(inputs):
    settings = typed(settings_of(start_day=1.0), CellSettings)
    loop = loop_settings(settings, 60)
    problem = cell_problem(CELL, inputs, settings, "dop853", loop)
    scene, epoch, k = problem.scene, float(inputs.bodies["epoch_et"]), 77
    time = epoch + 86_400.0 + scene.step_s * k
    with loaded(kernel_path("de421")):
        for place, body in (
            (scene.primaries[k, 0], 399),
            (scene.primaries[k, 1], 301),
            (scene.sun_position[k], 10),
        ):
            wanted = spiceypy.spkgps(body, time, "J2000", EARTH_MOON_BARYCENTER)[0]
            np.testing.assert_allclose(place * LENGTH_UNIT_KM, wanted, rtol=0, atol=1e-6)
    # an observer is a point of its periodic orbit in the instantaneous frame
    table = body_table(inputs.bodies)
    nodes = np.linspace(epoch, time, 100_001)
    rate = 1.0 / pulsating_frame(table, nodes).time
    passed = np.trapezoid(rate, nodes)
    states, periods = inputs.orbits["state"].values, inputs.orbits["period"].values
    assert problem.observer_slot.tolist() == [0, 0, 1]
    here = np.concatenate([scene.observer_position[:, k] * LENGTH_UNIT_KM, np.zeros((3, 3))], 1)
    found = from_inertial(here, pulsating_frame(table, time))[:, :3]
    for row, (orbit, phase) in enumerate(((0, 0.0), (0, 0.5), (2, 0.0))):
        wanted = propagate_periodic(
            states[orbit], periods[orbit], [passed + phase * periods[orbit]], method="dop853"
        )[0, :3]
        np.testing.assert_allclose(found[row], wanted, rtol=0, atol=1e-7)


def test_the_filter_tracks_truth_with_ephemeris_dynamics(inputs):
    cell = cell_dataset(CELL, inputs, settings_of(), propagator="dop853", seed=3)
    assert "J2000" in cell["true_translation"].attrs["long_name"]
    truth, times = cell["true_translation"].values[0], cell["time"].values
    ends = [EPOCH_JD + t / 86_400.0 for t in times]
    for j in range(3):
        wanted = propagate_utc(truth[0, j] * UNITS, ends[0], ends[-1:])[0]
        # radiation moves a state by a meter in two hours, a Julian date is good to 40 us
        assert np.linalg.norm((truth[-1, j] * UNITS - wanted)[:3]) < 2e-3
    used = cell["updates"].values > 0
    assert used.any()
    miss = np.abs(cell["error"].values[..., 6:]) / cell["sigma"].values[..., 6:]
    assert np.mean(miss[:, :, used[0]] < 3.0) > 0.95
    assert np.all(np.isfinite(cell["bound"].values[:, -1][:, used[0]]))


@pytest.fixture(scope="module")
def study():
    """The configuration of both pipelines with ephemeris dynamics."""
    return with_families(in_study(check_campaign(read_campaign("real.yaml"))))


@pytest.mark.parametrize(("estimator", "variant"), [("batch", ""), ("mukf", "paper-ephemeris")])
def test_both_pipelines(inputs, study, estimator, variant):
    """A small cell of each pipeline; errors of the recommended one are consistent."""
    own = cell_settings(scenario_settings(study, "A")["task2"], variant)
    table = {"table": str(ROOT / own["body"]["table"])}
    few = {"seeds": 1, "duration_hours": 3, "record_minutes": 20, "body": table}
    small = Cell("A", "information-20", estimator, 3, 60)
    cell = cell_dataset(small, inputs, merged(own, few), propagator="dop853", seed=3)
    assert ("slot" in cell.sizes) == ("parameter_sigma" in cell) == (estimator == "batch")
    used = cell["updates"].values[0] > 0
    assert used.any() and not cell["failed"].values.any()
    error, sigma = (cell[name].values[0][:, used, 6:9] for name in ("error", "sigma"))
    late = cell["time"].values > 3600.0
    known = LENGTH_UNIT_KM * np.linalg.norm(sigma, axis=-1)
    assert np.all(known[~late] > 50.0) and np.all(known[-1] < 20.0)
    assert estimator == "mukf" or np.mean(np.abs(error / sigma) < 3.0) > 0.95


def test_models_are_chosen_for_the_unmatched_truths(study):
    """The variants with a choice of models have the truths of the usual ones, and nothing else."""
    cells = study["task2"]["variants"]["cells"]
    chosen = [name for name in cells if name.startswith("selected-")]
    assert len(chosen) > 10
    for name in chosen:
        usual = cells[name.removeprefix("selected-")]["change"]
        batch = usual["batch"] | {"model_selection": {"effort": 1}}
        assert cells[name]["change"] == usual | {"batch": batch}
        settings = cell_settings(scenario_settings(study, "A")["task2"], name)["batch"]
        assert settings["noise_freedom"] == 4


def test_observers_are_on_refined_orbits(inputs, caplog):
    """Orbits of the data set; an observer without one is on its CR3BP orbit, or is refused."""
    dynamics = {**REAL, "observers": "refined"}
    settings = typed(settings_of(dynamics=dynamics, start_day=1.0), CellSettings)
    loop = loop_settings(settings, 60)
    chosen = {"dynamics": settings.dynamics.model_dump()}
    refined = refined_dataset(inputs.orbits, inputs.bodies, chosen)
    own = refined["node_orbit"].values == 2
    assert np.all(refined["position_miss"].values < 1.0)
    assert np.all(refined["velocity_miss"].values < 1.0)
    assert refined_rows(observers=refined)["refined"].tolist() == [3, 3]
    scene = cell_problem(CELL, inputs, settings, "dop853", loop).scene
    epoch = float(inputs.bodies["epoch_et"])
    path = RefinedPath(refined["node_time"].values[own], refined["node_state"].values[own], 0, 0)
    forces = forces_on_observers(inputs.bodies, chosen["dynamics"])
    assert forces.epoch == epoch
    time = 86_400.0 + scene.step_s * np.arange(scene.observer_position.shape[1])
    wanted = path_states(forces, path, time)[:, :3]
    np.testing.assert_allclose(scene.observer_position[2], wanted, rtol=0, atol=1e-9)
    lost = [1.0 - MU + 0.02, 0.0, 0.0, 0.0, 0.0, 0.0]  # falls into the Moon
    reference = observer_states(forces, settings.dynamics, np.array(lost), 0.0, 0.0, [0.0], "it")
    assert reference.shape == (1, 6) and "it, 0 of a period ahead, is not refined" in caplog.text
    refuses = settings.dynamics.model_copy(update={"unrefined": "refused"})
    with pytest.raises(ConfigurationError, match=r"set task2\.dynamics\.unrefined to 'reference'"):
        observer_states(forces, refuses, np.array(lost), 0.0, 0.0, [0.0], "it")


def test_impossible_settings_are_refused(inputs):
    settings = typed(settings_of(), CellSettings)
    loop = loop_settings(settings, 60)
    with pytest.raises(ConfigurationError, match=r"ephemeris/bodies\.nc"):
        cell_problem(CELL, inputs._replace(bodies=None), settings, "dop853", loop)
    late = typed(settings_of(start_day=2.99), CellSettings)
    with pytest.raises(ConfigurationError, match="table of Earth, Moon and Sun"):
        cell_problem(CELL, inputs, late, "dop853", loop)
    mixed = settings_of(dynamics={"truth": "cr3bp", "filter": "ephemeris"})
    with pytest.raises(ConfigurationError, match="set truth to 'ephemeris'"):
        checked(mixed, CellSettings)


def test_cells_share_the_refined_orbits_of_their_observers(inputs, tmp_path, monkeypatch):
    settings = typed(settings_of(start_day=1.0, dynamics=REFINED), CellSettings)
    dynamics = settings.dynamics.model_dump()
    given = inputs.architecture, inputs.orbits, inputs.bodies, {"dynamics": dynamics}
    write_dataset(flown_dataset(*given), tmp_path / "flown.nc")

    def places(**shared):
        problem = cell_problem(
            CELL, inputs._replace(**shared), settings, "dop853", loop_settings(settings, 60)
        )
        return problem.scene.observer_position

    own = places()

    def fails(*args, **more):
        raise ConvergenceError("not today")

    monkeypatch.setattr(refined_orbits, "refined_path", fails)
    np.testing.assert_array_equal(places(flown=read_dataset(tmp_path / "flown.nc")), own)
    # one that failed is not tried again, and stays on its CR3BP orbit
    reference = places()
    assert np.abs(reference - own).max() > 0.0
    monkeypatch.setattr(ephemeris_inputs, "refined_path", fails)
    lost = flown_dataset(*given)
    assert flown_paths(lost) == ["not today"] * 3
    np.testing.assert_array_equal(places(flown=lost), reference)


@pytest.mark.parametrize("eclipse", [False, True])
def test_static_targets_are_seen_from_refined_orbits(inputs, eclipse):
    """Every pair in km and J2000 axes with bodies by SPICE, against the tables of visibility."""
    seen = {"duration_days": 3, "step_hours": 6, "limiting_magnitude": 16, "target_radius_m": 1}
    seen |= {"diffuse_reflection_coefficient": 1, "eclipse": eclipse, "dynamics": "ephemeris"}
    seen["exclusion_deg"] = {"sun": 35, "moon": 5, "earth": 15}
    settings = {"epoch_jd": EPOCH_JD, "propagator": "dopri5", "visibility": seen}
    flown = {**settings, "dynamics": settings_of(dynamics=REFINED)["dynamics"]}
    orbits = inputs.orbits.assign(stability_index=("orbit", np.ones(3)))
    paths = paths_dataset(orbits, inputs.bodies, flown, 2)
    epoch, hours = float(inputs.bodies["epoch_et"]), np.arange(13) * 6.0
    forces, dynamics = (
        forces_on_observers(inputs.bodies, flown["dynamics"]),
        typed(flown["dynamics"], Dynamics),
    )
    with loaded(kernel_path("de421")):
        states = {
            body: np.array([
                spiceypy.spkgeo(code, epoch + 3600.0 * h, "J2000", EARTH_MOON_BARYCENTER)[0]
                for h in hours
            ])
            for body, code in (("sun", 10), ("moon", 301), ("earth", 399))
        }  # fmt: skip
    sun, moon, earth = (states[body][:, :3] for body in ("sun", "moon", "earth"))
    away = moon - earth
    axes = np.empty((13, 3, 3))
    axes[:, 0] = away / np.linalg.norm(away, axis=1)[:, None]
    up = np.cross(away, (states["moon"] - states["earth"])[:, 3:])
    axes[:, 2] = up / np.linalg.norm(up, axis=1)[:, None]
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    length = np.linalg.norm(away, axis=1)
    origin = (1.0 - MU) * earth + MU * moon
    target = np.random.default_rng(3).normal([1.0, 0.0, 0.0], 0.2, (150, 3))
    if eclipse:  # some are near the edge of the Earth's shadow at one time
        shade = earth[5] - sun[5]
        behind = earth[5] + 60_000.0 * shade / np.linalg.norm(shade)
        aside = behind + np.linspace(5_500.0, 7_000.0, 50)[:, None] * axes[5, 2]
        target[:50] = (aside - origin[5]) @ axes[5].T / length[5]
    place = origin[:, None] + length[:, None, None] * np.einsum("tji,nj->tni", axes, target)
    lit = 1.0
    if eclipse:
        both = np.stack([earth, moon], axis=1) / LENGTH_UNIT_KM
        lit = sunlit_share(place.swapaxes(0, 1) / LENGTH_UNIT_KM, sun / LENGTH_UNIT_KM, both).T
        assert np.any(lit == 0.0) and np.any((lit > 0.0) & (lit < 1.0))
    expected = np.zeros((3, 2, 13, 150), dtype=bool)
    traveled = np.zeros((3, 2))
    for orbit, phase in np.ndindex(3, 2):
        state, period = orbits["state"].values[orbit], orbits["period"].values[orbit]
        given = dynamics, state, period, 0.5 * phase, 3600.0 * hours, "one"
        observer = observer_states(forces, *given)[:, :3] * LENGTH_UNIT_KM
        line = place - observer[:, None]
        distance = np.linalg.norm(line, axis=-1)
        with np.errstate(divide="ignore"):
            dim = -2.5 * np.log10(lit)
        magnitude = sphere_magnitude(1e3 * distance, phase_angle(line, place - sun[:, None])) + dim
        clear = magnitude < 16.0
        for body, least in ((sun, 35.0), (moon, 5.0), (earth, 15.0)):
            toward = body - observer
            cosine = np.sum(line * toward[:, None], axis=-1) / distance
            cosine /= np.linalg.norm(toward, axis=1)[:, None]
            clear &= np.degrees(np.arccos(cosine)) > least
        expected[orbit, phase] = clear
        for body in (moon, earth):
            traveled[orbit, phase] += np.linalg.norm(observer - body, axis=1).sum()
    static = xr.Dataset({"position": (("target", "axis"), target)})
    found = visibility_dataset(orbits, static, paths, settings, 2)
    assert 0.02 < expected.mean() < 0.9
    np.testing.assert_array_equal(found["observations"][:, 0], expected[:, 0].sum(axis=1))
    np.testing.assert_array_equal(found["observations"][:, 1], expected.sum(axis=(1, 2)))
    np.testing.assert_allclose(found["distance"][:, 1], traveled.sum(axis=1) / LENGTH_UNIT_KM)
    ways = np.array([2, 0]), np.array([2, 1])
    covered = architecture_coverage(*ways, orbits, static, paths, settings)
    both = expected[2, 0] | expected[2, 1] | expected[0, 0]
    assert covered.union_coverage == both.mean()
    with pytest.raises(ConfigurationError, match="phases of an architecture are not in"):
        architecture_coverage(*ways, orbits, static, paths, settings, 0.3)
