"""
A survey that starts without a catalog
======================================

Six telescopes search for six unknown objects for six hours. Detections without identity are linked
to tracklets and orbits. The figure shows the number of objects in the catalog, of objects with
enough tracklets to be found, and the expected number of undetected ones. The page
:doc:`/docs/catalog` describes the method.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.dynamics import EARTH_MOON, propagate_bundle
from cislunar.survey import (
    DensityPrior,
    ObjectDensity,
    PriorSources,
    SurveySettings,
    run_survey,
    sample_prior,
)
from cislunar.tasking import TruthModel

problem = cs.tracking_problem(n_observers=6, n_targets=6, duration_hours=6)
sensor = cs.Sensor(limiting_magnitude=20)
truth = TruthModel(problem.surfaces, sensor.noise, np.zeros(3))
settings = SurveySettings(duration_days=0.25, link_hours=1, process={"false_alarms_deg2": 0.02})

# %%
# The prior contains the neighborhoods of the objects' orbits, at other points of these orbits.

rng = np.random.default_rng(1)
points = propagate_bundle(problem.epoch, 0.05, 60)[:, rng.integers(60, size=60)].reshape(-1, 6)
prior = DensityPrior(families=0, zero_velocity=0, table=0.8, uniform=0.2, particles=600,
                     expected_objects=10)  # fmt: skip
density = ObjectDensity(*sample_prior(prior, PriorSources(table=points), rng), 10)
found = run_survey(problem.scene, truth, problem.epoch, problem.ids, 3, density, settings,
                   sensor=sensor, forces=EARTH_MOON)  # fmt: skip
states = found.states
print(states[["day", "findable", "right", "wrong", "completeness", "purity"]].round(3))

figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
hours = 24.0 * states["day"]
panel.step(hours, states["findable"], where="post", color="gray", label="findable objects")
panel.plot(hours, states["right"], "o-", label="objects in the catalog")
panel.plot(hours, states["undetected"], "s:", label="expected undetected objects")
panel.set(xlabel="time since the beginning, h", ylabel="number of objects", ylim=(0.0, None))
panel.grid(alpha=0.3)
panel.legend(fontsize="small")
