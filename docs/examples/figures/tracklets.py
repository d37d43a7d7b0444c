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
from cislunar.orbit_determination import attributables, make_angles

halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
times_s = np.arange(0.0, 2400.0, 60.0)
times = times_s / TIME_UNIT_S
x, y, z = (cs.propagate(halo.state[0], times)[:, :3] - [-MU, 0.0, 0.0]).T
# from the rotating frame to axes that do not rotate
x, y = np.cos(times) * x - np.sin(times) * y, np.sin(times) * x + np.cos(times) * y


def angles_of(x, y, z):
    """Right ascension and declination of vectors."""
    return np.column_stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])


truth = angles_of(x, y, z)

# %%
# The directions have a standard deviation of five arcseconds.

arcsecond = np.pi / 648_000.0
sigma = 5.0 * arcsecond
seen = truth + np.random.default_rng(1).normal(0.0, sigma, truth.shape)
ra, dec = seen.T
vectors = np.column_stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
n = times.size
angles = make_angles(times, np.zeros(n, dtype=int), np.zeros((n, 3)), vectors, sigma)
found = attributables(angles, [np.arange(n)], rate=0.0, degree=1)
unit = arcsecond * TIME_UNIT_S
print(f"rate along right ascension: {found.basis[0, 0] @ found.rate[0] / unit:.4f} arcsec/s")
print(f"standard deviation:         {np.sqrt(found.covariance[0, 2, 2]) / unit:.4f} arcsec/s")
print(f"chi-squared: {found.chi_squared[0]:.1f} with {2 * n - 4} degrees of freedom")

line = angles_of(*(found.direction + (times - found.time[0])[:, None] * found.rate).T)
figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for k, name in enumerate(("right ascension", "declination")):
    panel.plot(times_s / 60.0, (seen - line)[:, k] / arcsecond, "o", label=f"{name}, detections")
    panel.plot(times_s / 60.0, (truth - line)[:, k] / arcsecond, label=f"{name}, truth")
panel.set(xlabel="time, minutes", ylabel="residual of the uniform motion, arcsec")
panel.grid(alpha=0.3)
panel.legend(fontsize="small")
