"""Times of the estimators, of tasking and of cells of one day, with the usual alternatives.

    python benchmarks/estimation.py [--targets 20 50 100 202] [--observers 20] [--ratios]

With `--ratios` only the cost of ephemeris forces, of late measurements, of Gaussian mixtures and of
tests for maneuvers is measured. Propagation is compared with SciPy's RK45 at the paper's tolerance.
The problem needs no file: its observers and near-periodic targets replace those of the paper.
Everything runs on one thread; compilation is not counted.
"""

import argparse
from functools import partial
from time import perf_counter

import numpy as np
from _timing import alternated, best_time
from numba import njit
from scipy.integrate import solve_ivp

from cislunar.attitude.rigid_body import propagate_spherical
from cislunar.campaign.tracking.ephemeris_inputs import CellEphemeris, ephemeris_scene
from cislunar.constants import GM_UNIT_KM3_S2, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle, step_bundle, step_cloud
from cislunar.dynamics.cr3bp import EARTH_MOON, equations_of_motion
from cislunar.dynamics.ephemeris import UNITS, forces_between
from cislunar.dynamics.ephemeris_forces import EphemerisForces
from cislunar.dynamics.frames import pulsating_frame, to_inertial
from cislunar.dynamics.instantaneous_frame_cr3bp import inertial_states
from cislunar.dynamics.tableau import STAGES8
from cislunar.ephemeris.bodies import GM_MOON
from cislunar.estimation import ESTIMATORS, Abilities, estimator_named
from cislunar.estimation.kalman.mukf import MultiplicativeUKF
from cislunar.estimation.light_curves.batch import BatchEstimator, batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.light_curve import cost, cost_and_derivatives
from cislunar.estimation.light_curves.row_blocks import (
    MAGNITUDE,
    RANGE,
    SUN,
    TIME,
    VIEW,
    WEIGHT,
)
from cislunar.estimation.maneuvers import ManeuverDetection, monitored
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.measurement import DETECTED, measure
from cislunar.observation.records import pointed_schedule
from cislunar.observation.sensor import Sensor
from cislunar.photometry.body_blocks import body_magnitude
from cislunar.photometry.materials import PRINTED
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.communication.model import CommunicationModel
from cislunar.tasking.decision import decide
from cislunar.tasking.demonstration import TrackingProblem, tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.planning.assignment import IDLE, assign
from cislunar.tasking.planning.detection import LearnedDetection
from cislunar.tasking.planning.detection_model import DetectionModel
from cislunar.tasking.planning.information import TaskingModel, pair_information
from cislunar.tasking.planning.preselection import assign_preselected
from cislunar.tasking.planning.schedule_model import ScheduleModel
from cislunar.tasking.truth import TrueMotion, TruthModel

SENSOR = Sensor(limiting_magnitude=24.0)
LOW_LUNAR_KM = (170.0, 4313.0), (109.0, 8920.0), (164.0, 18074.0), (118.0, 4412.0)
"""Altitudes of perilune and apolune of four low lunar targets of the campaign."""


def filter_times() -> None:
    """Print the time of prediction and update per target and step."""
    scene, surfaces, epoch, ids, loop = tracking_problem(5, 5, PRINTED, duration_hours=24.0)
    initial = initial_estimate(epoch, loop.initial.components())
    truth = TrueMotion(initial, scene, SENSOR.noise, 3, ids).advance(loop.n_steps)
    observations = pointed_schedule(np.tile(np.arange(5), (loop.n_steps, 1)), 5)
    measured, _ = measure(
        1, observations, scene, surfaces, SENSOR, truth.translation, truth.quaternion, truth.noise
    )

    def run_filter(measurements):
        filt = MultiplicativeUKF(scene, surfaces, SENSOR, initial)
        return filt.advance(measurements)

    nothing = measured.where(np.zeros(observations.observer.size, dtype=bool))
    updates = int(run_filter(measured).used.sum())
    count = 5 * loop.n_steps
    predict = best_time(lambda: run_filter(nothing)) / count
    update = (best_time(lambda: run_filter(measured)) - predict * count) / updates
    print(f"predict {1e6 * predict:7.2f} us   update {1e6 * update:7.2f} us   per target and step")


@njit
def misfit_row_by_row(data, quaternion, omega, model):
    """Sum of squared residuals of a body of spherical inertia, one row at a time."""
    total = 0.0
    for k in range(data.shape[0]):
        row = data[k]
        h = body_magnitude(
            propagate_spherical(quaternion, omega, row[TIME]),
            row[SUN],
            row[VIEW],
            row[RANGE],
            model.surface,
            model.irradiance_4pi,
            model.fresnel_sqrt,
        )
        total += row[WEIGHT] * (row[MAGNITUDE] - h) ** 2
    return total


def light_curve_times() -> None:
    """Print the time of a magnitude, and of its derivative in closed form and by differences."""
    scene, surfaces, epoch, ids, loop = tracking_problem(5, 5, PRINTED, duration_hours=12.0)
    initial = initial_estimate(epoch, loop.initial.components())
    truth = TrueMotion(initial, scene, SENSOR.noise, 3, ids).advance(loop.n_steps)
    observations = pointed_schedule(np.tile(np.arange(5), (loop.n_steps, 1)), 5)
    measured, outcome = measure(
        1, observations, scene, surfaces, SENSOR, truth.translation, truth.quaternion, truth.noise
    )
    estimator = batch()(scene, surfaces, SENSOR, initial, np.random.default_rng(0), EARTH_MOON)
    estimator.advance(measured)
    j = int(np.argmax((outcome == DETECTED).reshape(5, -1).sum(axis=1)))
    data, model, anchor = estimator.light_curve(j)
    u, gradient, information = np.full(6, 0.1), np.empty(6), np.empty((6, 6))

    def by_differences():
        for c in range(6):
            for step in (1e-4, -1e-4):
                near = u.copy()
                near[c] += step
                cost(near, data, anchor, model, np.inf)
        return cost(u, data, anchor, model, np.inf)

    rows = data.shape[0]
    nominal = model.quaternion, model.omega
    plain = 0.5 * misfit_row_by_row(data, *nominal, model) / model.noise_variance
    np.testing.assert_allclose(cost(np.zeros(6), data, anchor, model, np.inf), plain, rtol=1e-9)
    one = best_time(lambda: cost(u, data, anchor, model, np.inf), 20) / rows
    exact = (
        best_time(lambda: cost_and_derivatives(u, data, anchor, model, gradient, information), 20)
        / rows
    )
    differences = best_time(by_differences, 20) / rows
    single = best_time(lambda: misfit_row_by_row(data, *nominal, model), 20) / rows
    print(
        f"light curve, per row: magnitude {1e9 * one:.0f} ns, one row at a time "
        f"{1e9 * single:.0f} ns   time ratio {single / one:.1f}\n"
        f"light curve, per row: with derivative {1e9 * exact:.0f} ns, by central differences "
        f"{1e9 * differences:.0f} ns   time ratio {differences / exact:.1f}"
    )


@njit
def _steps(step, count, points, dt, slopes, work):
    """Several steps of sigma points, in place."""
    for _ in range(count):
        step(EARTH_MOON, 0.0, points, dt, slopes, work)


def cloud_times() -> None:
    """Print the time of a step of sigma points of order 8, and of order 5 (away from bodies)."""
    _, _, epoch, _, loop = tracking_problem(1, 3, PRINTED)
    dt, times, ends = loop.step_s / TIME_UNIT_S, [], []
    for step in (step_bundle, step_cloud):
        ends.append(np.repeat(epoch[2][:, None], 25, axis=1))
        slopes, work = np.empty((STAGES8, 6, 25)), np.empty((6, 25))
        _steps(step, 1440, ends[-1], dt, slopes, work)
        points = np.repeat(epoch[2][:, None], 25, axis=1)
        times.append(
            best_time(lambda s=step, a=(points, dt, slopes, work): _steps(s, 1440, *a)) / 1440
        )
    print(
        f"25 sigma points, 60 s, on a halo: order 8 {1e6 * times[0]:.2f} us, order 5 "
        f"{1e6 * times[1]:.2f} us   time ratio {times[0] / times[1]:.1f}, difference "
        f"{np.abs(ends[0] - ends[1]).max():.0e} after a day"
    )


def propagation_times() -> None:
    """Print the time of propagating 25 sigma points over a minute."""
    _, _, epoch, _, loop = tracking_problem(1, 1, PRINTED)
    step = loop.step_s / 375_190.3
    points = np.repeat(epoch, 25, axis=0)
    compiled = best_time(lambda: propagate_bundle(points, step, 1000)) / 1000

    def by_scipy():
        for point in points:
            solve_ivp(
                lambda _, y: equations_of_motion(y), (0.0, step), point, rtol=1e-10, atol=1e-10
            )

    scipy = best_time(by_scipy)
    print(
        f"25 sigma points, 60 s: one DOP853 step {1e6 * compiled:.2f} us, "
        f"SciPy RK45 1e-10 {1e6 * scipy:.0f} us   time ratio {scipy / compiled:.0f}"
    )


def tasking_times(n_observers: int, n_targets: int) -> None:
    """Print the time of the information of all pairs and of the assignment at one epoch."""
    scene, surfaces, epoch, _, loop = tracking_problem(
        n_observers, n_targets, PRINTED, duration_hours=1.0
    )
    initial = initial_estimate(epoch, loop.initial.components())
    prediction = MultiplicativeUKF(scene, surfaces, SENSOR, initial).predict()

    def pairs():
        return pair_information(prediction, scene, surfaces, SENSOR, TaskingModel())

    matrix = pairs()
    line = f"tasking, {n_observers} observers, {n_targets} targets: "
    line += f"information {1e3 * best_time(pairs):.2f} ms"
    for method in ("exact", "greedy"):
        line += f", {method} {1e3 * best_time(lambda m=method: assign(matrix, m)):.3f} ms"
    start = perf_counter()
    search = assign(matrix, "tpe", rng=np.random.default_rng(0), max_evaluations=60)
    line += f", tpe {1e3 * (perf_counter() - start) / search.history.size:.0f} ms per evaluation"
    line += f" ({search.information / assign(matrix).information:.3f} of exact after 60)"
    print(line)


def preselection_time(n_observers: int, n_targets: int) -> None:
    """Print the time of the exact assignment from all pairs and from preselected pairs."""
    scene, surfaces, epoch, _, loop = tracking_problem(
        n_observers, n_targets, PRINTED, duration_hours=1.0
    )
    initial = initial_estimate(epoch, loop.initial.components())
    prediction = MultiplicativeUKF(scene, surfaces, SENSOR, initial).predict()
    known = prediction, scene, surfaces, SENSOR, TaskingModel()
    every, few = assign(pair_information(*known)), assign_preselected(*known)
    times = [
        best_time(lambda: assign(pair_information(*known))),
        best_time(lambda: assign_preselected(*known)),
    ]
    print(
        f"tasking, {n_observers} observers, {n_targets} targets: from all pairs "
        f"{1e3 * times[0]:.0f} ms, preselected {1e3 * times[1]:.0f} ms   "
        f"time ratio {times[0] / times[1]:.1f}, "
        f"{np.count_nonzero(every.target != few.target)} observers assigned differently"
    )


def decision_time(n_observers: int, n_targets: int) -> None:
    """Print the time of a tasking decision: paper, learned detection, and recommended mode."""
    line = f"decision, {n_observers} observers, {n_targets} targets:"
    learning = DetectionModel()
    for name, tasking, slots in (
        ("paper", TaskingModel(), None),
        ("learned", TaskingModel(detection=learning), None),
        ("recommended", TaskingModel(detection=learning, measurements=20), 20.0),
    ):
        scene, surfaces, epoch, _, loop = tracking_problem(
            n_observers, n_targets, PRINTED, duration_hours=1.0, sensor=SENSOR, tasking=tasking,
            schedule=ScheduleModel(slot_minutes=slots),
        )  # fmt: skip
        initial = initial_estimate(epoch, loop.initial.components())
        prediction = MultiplicativeUKF(scene, surfaces, SENSOR, initial).predict()
        detection = None if tasking.detection is None else LearnedDetection(learning, n_targets)
        idle = np.full(n_observers, IDLE)
        given = prediction, 60, scene, surfaces, loop, EARTH_MOON, detection, idle, None
        line += f" {name} {1e3 * best_time(lambda g=given: decide(*g)):.1f} ms"
    print(line)


def cell_time(n_observers: int, n_targets: int) -> None:
    """Print the time of a cell of one day with one realization and exact tasking, by estimator."""
    problem = tracking_problem(n_observers, n_targets, PRINTED)
    line = f"cell of one day, {n_observers} observers, {n_targets:3d} targets:"
    for name in ESTIMATORS:

        def run(name=name):
            return run_closed_loop(*problem[:4], [0], problem[4], estimator=name)

        line += f" {name} {best_time(run, 2):.2f} s,"
    print(f"{line[:-1]}   ({run().valid.sum()} updates)")


def ephemeris_refined(problem: TrackingProblem) -> tuple[tuple, EphemerisForces]:
    """The same satellites and targets in ephemeris dynamics, and the forces."""
    scene, surfaces, epoch, ids, loop = problem
    forces = forces_between("2024-10-01", "2024-10-03", area_to_mass=0.01)
    table, start = forces.table, forces.epoch
    observers = np.zeros((*scene.observer_position.shape[:2], 6))
    observers[..., :3] = scene.observer_position
    tracks = to_inertial(observers, pulsating_frame(table, start + loop.elapsed_s)) / UNITS
    states, _ = inertial_states(epoch, table, start)
    sky = CellEphemeris(table, start, start)
    return (ephemeris_scene(sky, tracks[..., :3], loop), surfaces, states, ids), forces


def forces_cost(n_observers: int, n_targets: int, rounds: int = 2) -> None:
    """Print the processor time of a cell of one day in ephemeris dynamics relative to the CR3BP."""
    problem = tracking_problem(n_observers, n_targets, PRINTED)
    cells = {"CR3BP": (problem[:4], EARTH_MOON), "ephemeris": ephemeris_refined(problem)}
    for name in ESTIMATORS:

        def run(cell, name=name):
            given, forces = cell
            truth = TruthModel(problem.surfaces, SENSOR.noise, np.zeros(3), forces)
            settings = {"estimator": name, "truth": truth, "forces": forces}
            run_closed_loop(*given, [0, 1], problem.loop, **settings)

        times = alternated({key: partial(run, cell) for key, cell in cells.items()}, rounds)
        print_ratio(f"cell of one day, {n_targets} targets, two realizations, {name}", times)


class EveryStep(BatchEstimator):
    """The batch estimator with estimates at all steps, also of intervals processed again."""

    def advance(self, measurements, *, histories=True, **given):
        return super().advance(measurements, **given)


def late_cost(n_observers: int, n_targets: int, rounds: int = 2) -> None:
    """Print the processor time of a cell of one day with bodies to be estimated whose measurements
    arrive an hour late, with estimates at all steps and without those that nothing needs."""
    problem = tracking_problem(
        n_observers, n_targets, PRINTED, sensor=SENSOR,
        communication=CommunicationModel(delay_minutes=60.0),
    )  # fmt: skip
    unknown = BodyParameterPrior(
        log_albedo=0.25, log_slope=0.25, log_inertia=0.05, angular_acceleration_deg_h2=0.01
    )
    factory = batch(BatchSettings(noise_freedom=4.0, estimated_parameters=unknown))

    def at_every_step(*given):
        estimator = factory(*given)
        estimator.__class__ = EveryStep
        return estimator

    at_every_step.abilities = Abilities(unknown)
    ways = {
        name: partial(run_closed_loop, *problem[:4], [0], problem.loop, estimator=estimator)
        for name, estimator in (("all steps", at_every_step), ("needed steps", factory))
    }
    print_ratio(
        f"cell of one day, {n_targets} targets, an hour late, batch", alternated(ways, rounds)
    )


def splitting_cost(n_observers: int, n_targets: int, rounds: int = 2) -> None:
    """Print the processor time of a cell of one day with Gaussian mixtures relative to one without.

    One target in 20 is on a low lunar orbit, as in the campaign, where mixtures are needed.
    """
    problem = tracking_problem(n_observers, n_targets, PRINTED)
    for k, j in enumerate(range(0, n_targets, 20)):
        problem.epoch[j] = low_lunar(*LOW_LUNAR_KM[k % len(LOW_LUNAR_KM)])
    for name in ESTIMATORS:

        def run(splitting, name=name):
            estimator = estimator_named(name, splitting=splitting)
            run_closed_loop(*problem[:4], [0, 1], problem.loop, estimator=estimator)

        ways = {"one Gaussian": partial(run, False), "mixture": partial(run, True)}
        times = alternated(ways, rounds)
        print_ratio(f"cell of one day, {n_targets} targets, two realizations, {name}", times)


def monitoring_cost(n_observers: int, n_targets: int, rounds: int = 2) -> None:
    """Print the processor time of a cell of one day whose targets are tested for maneuvers,
    relative to one without tests. No target maneuvers."""
    problem = tracking_problem(n_observers, n_targets, PRINTED, sensor=SENSOR)
    settings = ManeuverDetection(false_alarms_per_target_day=1e-3, recover=True)
    for name in ESTIMATORS:
        plain = estimator_named(name)
        ways = {
            way: partial(run_closed_loop, *problem[:4], [0, 1], problem.loop, estimator=each)
            for way, each in (("plain", plain), ("tested", monitored(plain, settings)))
        }
        times = alternated(ways, rounds)
        print_ratio(f"cell of one day, {n_targets} targets, two realizations, {name}", times)


def low_lunar(perilune_km: float, apolune_km: float) -> np.ndarray:
    """State in the CR3BP at the perilune, beyond the Moon, of an orbit with these altitudes."""
    near, far = MOON_RADIUS_KM + np.array([perilune_km, apolune_km])
    speed = np.sqrt(2.0 * GM_MOON / GM_UNIT_KM3_S2 * LENGTH_UNIT_KM * far / (near * (near + far)))
    x = near / LENGTH_UNIT_KM
    return np.array([1.0 - MU + x, 0.0, 0.0, 0.0, 0.6 * speed - x, 0.8 * speed])


def print_ratio(what: str, times: dict[str, float]) -> None:
    """Print the processor times of two alternatives and the ratio of the second to the first."""
    (usual, one), (other, two) = times.items()
    print(
        f"{what}: {usual} {one:.2f} s, {other} {two:.2f} s   time ratio {two / one:.2f}", flush=True
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, nargs="+", default=[20, 50, 100, 202])
    parser.add_argument("--observers", type=int, default=20)
    parser.add_argument(
        "--ratios", action="store_true", help="only the cost of forces, delays, mixtures and tests"
    )
    options = parser.parse_args()
    forces_cost(options.observers, 50)
    late_cost(options.observers, 50)
    splitting_cost(options.observers, 100)
    monitoring_cost(options.observers, 100)
    if options.ratios:
        return
    filter_times()
    light_curve_times()
    cloud_times()
    propagation_times()
    for n_targets in options.targets:
        tasking_times(options.observers, n_targets)
    decision_time(43, 100)
    preselection_time(100, 10_000)
    for n_targets in options.targets:
        cell_time(options.observers, n_targets)


if __name__ == "__main__":
    main()
