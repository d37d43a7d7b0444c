"""
What a force is worth
=====================

A spacecraft about the Moon under Earth, Moon and Sun where the ephemeris has them: what sunlight
adds in a week, and what the figure of the Moon is worth.
"""

import matplotlib.pyplot as plt
import numpy as np

from cislunar.dynamics.ephemeris import forces_between, propagate_utc

start, week = 2460584.5, np.linspace(0.05, 7.0, 140)
state = [-60_000.0, 0.0, 20_000.0, 0.0, 0.25, 0.0]  # km and km/s about the Moon
span = start, start + 7.0
parts = {
    "with sunlight on 0.02 m2/kg": forces_between(*span, area_to_mass=0.02, reflectivity=1.3),
    "without the figure of the Moon": forces_between(*span, figure=False),
}
usual = propagate_utc(state, start, list(start + week), center="moon")

figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for name, forces in parts.items():
    other = propagate_utc(state, start, list(start + week), center="moon", forces=forces)
    panel.semilogy(week, 1e3 * np.linalg.norm((other - usual)[:, :3], axis=1), label=name)
panel.set(
    xlabel="days",
    ylabel="departure, m",
    title="Departure from the default forces, 63 000 km from the Moon",
)
panel.grid(alpha=0.3)
panel.legend()
