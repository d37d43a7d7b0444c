"""
A tracklet from detections
==========================

A tracklet is a direction and a rate that are fitted to the detections of one pass. The figure shows
the residuals of an object on a halo orbit, seen from the center of the Earth over forty minutes.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.constants import MU, TIME_UNIT_S
from cislunar.detection import tracklet

halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
times_s = np.arange(0.0, 2400.0, 60.0)
path = cs.propagate(halo.state[0], times_s / TIME_UNIT_S)
x, y, z = (path[:, :3] - [-MU, 0.0, 0.0]).T
angle = times_s / TIME_UNIT_S  # from the rotating frame to axes that do not rotate
x, y = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
truth = np.column_stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])

# %%
# The directions have a standard deviation of five arcseconds.

arcsecond = np.pi / 648_000.0
sigma = 5.0 * arcsecond
seen = truth + np.random.default_rng(1).normal(0.0, sigma, truth.shape)
variance = np.full(seen.shape, sigma**2)
found = tracklet(0, np.arange(times_s.size), times_s, seen, variance)
ra, dec, ra_rate, dec_rate = found.attributable
deviation = np.sqrt(np.diag(found.covariance))
print(f"rate in right ascension: {ra_rate / arcsecond:.4f} arcsec/s")
print(f"standard deviation:      {deviation[2] / arcsecond:.4f} arcsec/s")
print(f"chi-squared: {found.chi_squared:.1f} with {2 * times_s.size - 4} degrees of freedom")

line = np.array([ra, dec]) + (times_s - found.time_s)[:, None] * np.array([ra_rate, dec_rate])
figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for k, name in enumerate(("right ascension", "declination")):
    panel.plot(times_s / 60.0, (seen - line)[:, k] / arcsecond, "o", label=f"{name}, detections")
    panel.plot(times_s / 60.0, (truth - line)[:, k] / arcsecond, label=f"{name}, truth")
panel.set(xlabel="time, minutes", ylabel="residual of the uniform motion, arcsec")
panel.grid(alpha=0.3)
panel.legend(fontsize="small")
