"""Sets of kernels that the jobs of the campaign need, each loaded by a minimal problem.

``python -m cislunar.campaign.kernels`` compiles those of searches and tracking, or the given sets,
before many jobs need them.
"""

import sys
from collections.abc import Mapping
from functools import partial
from typing import Any, Literal

from cislunar.estimation.names import ESTIMATORS
from cislunar.runtime.kernels import KernelSet, compile_kernels, drop_stale_kernels


def _track(estimator: str) -> None:
    """An estimator on a minimal problem."""
    from cislunar.tasking.closed_loop import ClosedLoop
    from cislunar.tasking.demonstration import tracking_problem

    problem = tracking_problem(2, 3, duration_hours=2, interval_minutes=60)
    for _ in ClosedLoop(*problem[:4], [1], problem.loop, estimator=estimator).pieces():
        pass


def _track_ephemeris(estimator: str, assumed: Literal["ephemeris", "cr3bp"]) -> None:
    """An estimator with ephemeris truth and either assumed model; a refined orbit."""
    import numpy as np

    from cislunar.campaign.data import forces_of
    from cislunar.campaign.settings.cell_tree import CellSettings, Dynamics
    from cislunar.campaign.tracking import ephemeris_inputs
    from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
    from cislunar.dynamics import inertial_states
    from cislunar.ephemeris.bodies import tabulate_bodies
    from cislunar.tasking.closed_loop import ClosedLoop
    from cislunar.tasking.demonstration import tracking_problem
    from cislunar.tasking.truth import TruthModel

    problem = tracking_problem(2, 3, duration_hours=2, interval_minutes=60)
    dynamics = Dynamics(truth="ephemeris", filter=assumed, observers="refined")
    settings = CellSettings.model_construct(dynamics=dynamics)
    ephemeris = ephemeris_inputs.CellEphemeris(
        tabulate_bodies(0.0, 0.1 * SECONDS_PER_DAY), 0.0, 0.0
    )
    observed = problem.epoch[:2], [SECONDS_PER_DAY / TIME_UNIT_S] * 2, [np.zeros(1)] * 2
    tracks = ephemeris_inputs.observer_tracks(
        ephemeris, dynamics, *observed, problem.loop.elapsed_s
    )
    scene = ephemeris_inputs.ephemeris_scene(ephemeris, tracks, problem.loop)
    placed, low_lunar = inertial_states(problem.epoch, ephemeris.table, ephemeris.start)
    surfaces, noise = problem.surfaces, problem.loop.sensor.noise
    true_forces = forces_of(ephemeris.table, ephemeris.start, dynamics)
    truth = TruthModel(surfaces, noise, np.zeros(3), true_forces)
    forces = ephemeris_inputs.assumed_forces(ephemeris, settings, problem.loop, low_lunar)
    given = {"estimator": estimator, "truth": truth, "forces": forces}
    for _ in ClosedLoop(scene, surfaces, placed, problem.ids, [1], problem.loop, **given).pieces():
        pass


def _search() -> None:
    """Both samplers and the cost J on minimal tables; Hyperopt is loaded as well."""
    import numpy as np

    from cislunar.architecture.cost import CostFunction
    from cislunar.architecture.hyperopt_search import hyperopt_search
    from cislunar.architecture.tables import ArchitectureTables

    tables = ArchitectureTables(
        observations=np.arange(12, dtype=np.uint16).reshape(3, 2, 2),
        distance=np.ones((3, 2)),
        stability_index=np.arange(1.0, 4.0),
        family=np.array(["Halo_L1_N"] * 3),
        n_steps=12,
    )
    for method in ("random", "tpe-compiled"):
        hyperopt_search(
            CostFunction(tables),
            method=method,
            rng=np.random.default_rng(0),
            n_slots=2,
            max_evaluations=25,
            early_stop=None,
        )


_PROBLEM = ("tasking/closed_loop.py", "tasking/demonstration.py")
_EPHEMERIS = ("tasking/closed_loop.py", "campaign/tracking/ephemeris_inputs.py")

KERNEL_SETS = {
    "search": KernelSet(_search, ("architecture/hyperopt_search.py", "architecture/cost.py")),
    **{f"tracking-{name}": KernelSet(partial(_track, name), _PROBLEM) for name in ESTIMATORS},
    **{
        f"tracking-{name}-{assumed}": KernelSet(
            partial(_track_ephemeris, name, assumed), _EPHEMERIS
        )
        for name in ESTIMATORS
        for assumed in ("ephemeris", "cr3bp")
    },
}
"""Sets that are expensive to compile: of searches, and of tracking by the estimator, with ephemeris
truth also by the assumed dynamics."""


def kernel_set(name: str) -> str:
    """A set of `KERNEL_SETS` as `cislunar.runtime.kernels.compile_kernels` takes it."""
    return f"{__name__}:KERNEL_SETS:{name}"


def tracking_kernels(settings: Mapping[str, Any], estimator: str) -> str:
    """The kernels of a tracking cell with these settings and this estimator."""
    dynamics = settings.get("dynamics", {})
    assumed = f"-{dynamics['filter']}" if dynamics.get("truth") == "ephemeris" else ""
    return kernel_set(f"tracking-{estimator}{assumed}")


def tracking_files(settings: Mapping[str, Any], estimator: str) -> set[str]:
    """Files of the kernels of a tracking cell, which may not need all of them."""
    return KERNEL_SETS[tracking_kernels(settings, estimator).rpartition(":")[2]].files()


if __name__ == "__main__":
    drop_stale_kernels()
    usual = ("search", *(f"tracking-{name}" for name in ESTIMATORS))
    for each in sys.argv[1:] or usual:
        compile_kernels(f"cislunar.campaign.kernels:KERNEL_SETS:{each}")
