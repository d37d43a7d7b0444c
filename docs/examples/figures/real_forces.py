"""
Effect of single forces
=======================

How far does a trajectory deviate if one force is added or omitted? A spacecraft starts 63,000 km
from the Moon, with Earth, Moon and Sun from the DE421 ephemeris. Over a week its position is
compared with that under the default forces: with solar radiation pressure added, and without the
harmonics J2 and C22 of the lunar gravity field.
"""

import matplotlib.pyplot as plt
import numpy as np

from cislunar.dynamics.ephemeris import forces_between, propagate_utc

start, week = 2460584.5, np.linspace(0.05, 7.0, 140)
state = [-60_000.0, 0.0, 20_000.0, 0.0, 0.25, 0.0]  # km and km/s about the Moon
span = start, start + 7.0
variations = {
    "with radiation, 0.02 m2/kg": forces_between(*span, area_to_mass=0.02, reflectivity=1.3),
    "without lunar J2 and C22": forces_between(*span, figure=False),
}
default = propagate_utc(state, start, list(start + week), center="moon")

figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for name, forces in variations.items():
    other = propagate_utc(state, start, list(start + week), center="moon", forces=forces)
    panel.semilogy(week, 1e3 * np.linalg.norm((other - default)[:, :3], axis=1), label=name)
panel.set(
    xlabel="time, days",
    ylabel="difference in position, m",
    title="Difference from the default forces",
)
panel.grid(alpha=0.3)
panel.legend()
