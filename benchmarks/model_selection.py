"""Processor time of the selection between models of the bodies.

    python benchmarks/model_selection.py [--targets 20] [--observers 20] [--rounds 1]

Cells of one day by the batch estimator with the recommended settings, without and with the
selection. The true bodies have the assumed reflection law, or reflect by the Lambert-Phong law; the
shape is the assumed one. The problem needs no file: its observers and near-periodic targets replace
those of the paper. Everything runs on one thread; compilation is not counted.
"""

import argparse
from functools import partial

import numpy as np
from _timing import alternated

from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.model_selection import ModelSelectionSettings
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material, PhotometryModel
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.truth import TruthModel

PRIOR = BodyParameterPrior(
    log_albedo=0.25, log_slope=0.25, logit_reflectance=0.5, log_inertia=0.05,
    angular_acceleration_deg_h2=0.01,
)  # fmt: skip
RECOMMENDED = {
    "modes": 16,
    "first_starts": 16,
    "noise_freedom": 4,
    "most_searches": 8,
    "estimated_parameters": PRIOR,
}
LAWS = ("cook-torrance", "lambert-phong")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=20)
    parser.add_argument("--observers", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=1, help="rounds, of which the least counts")
    options = parser.parse_args()
    problem = tracking_problem(options.observers, options.targets, PhotometryModel())
    for law in LAWS:
        photometry = PhotometryModel(reflection=law)
        surfaces = target_surfaces(icosahedron(), Material(), options.targets, photometry)
        noise = problem.loop.sensor.noise
        truth = TruthModel(surfaces, noise, np.zeros(3), parameter_sigma=PRIOR)
        ways = {}
        for effort in (0, 1):
            settings = BatchSettings(**RECOMMENDED, model_selection=ModelSelectionSettings(effort))
            given = {"estimator": batch(settings), "truth": truth}
            ways[effort] = partial(run_closed_loop, *problem[:4], [1], problem.loop, **given)
        without, selected = alternated(ways, options.rounds).values()
        print(
            f"true law {law}, {options.targets} targets: {without:.1f} s without selection, "
            f"{selected:.1f} s with it   time ratio {selected / without:.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
