"""
When a telescope sees an object
===============================

A telescope on an L2 halo orbit observes a sphere of 0.4 m radius on an L1 Lyapunov orbit for two
weeks. The figure shows magnitude and phase angle, and why there is no detection at some times.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.observation.measurement import DETECTED, EXCLUDED, FAINT, OCCULTED

sky = cs.sample_ephemeris("2024-10-01", duration_days=14.0, step_minutes=30.0)
halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
lyapunov = cs.periodic_orbits("Lyap_L1", jacobi=3.1)
observer, target = (
    cs.propagate_periodic(orbit.state[0], orbit.period[0], sky.time)[:, :3]
    for orbit in (halo, lyapunov)
)
found = cs.sightings(observer, target, sky.sun_position, radius_m=0.4)

days = np.arange(sky.time.size) * 30.0 / 1440.0
meanings = {
    DETECTED: "detected",
    FAINT: "too faint",
    EXCLUDED: "too close to Sun, Moon or Earth",
    OCCULTED: "hidden by Moon or Earth",
}
for outcome, meaning in meanings.items():
    print(f"{meaning}: {np.mean(found.outcome == outcome):.0%} of the times")

figure, (above, below) = plt.subplots(2, sharex=True, figsize=(8.0, 5.0), layout="constrained")
for outcome, meaning in meanings.items():
    chosen = found.outcome == outcome
    above.plot(days[chosen], found.magnitude[chosen], ".", label=meaning)
above.invert_yaxis()
above.set(ylabel="apparent magnitude")
above.legend(loc="lower right", fontsize="small")
below.plot(days, found.phase_angle_deg)
below.set(xlabel="time, days", ylabel="phase angle, deg")
for panel in (above, below):
    panel.grid(alpha=0.3)
