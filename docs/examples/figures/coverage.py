"""
Coverage against the number of satellites
=========================================

How many target-hours do one to eight satellites observe? The figure shows the largest coverage
found, an upper bound that no choice can exceed, and the mean of 50 random choices, for 60 static
targets over six days. Satellites occupy the orbit slots of 13 orbits with 12 phases each.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.architecture.coverage.certificate import certify_coverage
from cislunar.architecture.coverage.objective import CoverageObjective
from cislunar.architecture.coverage.tables import coverage_tables
from cislunar.visibility.counts import VisibilitySettings, observation_times

orbits = cs.observer_library({"Halo_L1_N": 4, "Halo_L2_S": 4, "Butterfly_N": 2, "Lyap_L1": 3})
times = observation_times(duration_days=6.0, step_hours=2.0)
sun = cs.sample_ephemeris(epoch_jd=2460584.5, duration_days=6.0, step_minutes=120.0)
targets = np.random.default_rng(1).normal([0.98785, 0.0, 0.0], 0.3, size=(60, 3))
settings = VisibilitySettings(limiting_magnitude=15.5)
tables = coverage_tables(orbits, targets, times, sun.sun_position, settings, phases=12)
objective = CoverageObjective(tables)

numbers = range(1, 9)
found = [certify_coverage(objective, number) for number in numbers]
for number, best in zip(numbers, found, strict=True):
    print(f"{number} satellites: {best.value:.3f} of the target-hours, at most {best.bound:.3f}")

rng = np.random.default_rng(2)
one_each = [np.ones(number, dtype=np.int64) for number in numbers]
random_mean = [
    np.mean([objective.value(rng.choice(objective.n_orbits, n.size, False), n) for _ in range(50)])
    for n in one_each
]

figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
panel.plot(numbers, [best.bound for best in found], "--", color="gray", label="upper bound")
panel.plot(numbers, [best.value for best in found], "o-", label="best found")
panel.plot(numbers, random_mean, "s-", label="random choice, mean of 50")
panel.set(xlabel="satellites", ylabel="share of target-hours observed", ylim=(0.0, 1.0))
panel.grid(alpha=0.3)
panel.legend()
