"""
Compare sensors
===============

Which sensor detects a target more often? A sensor is defined by its limiting magnitude, its noise,
its field of view and its exclusion angles from Sun, Moon and Earth. Its detection outcomes can be
computed before any filter runs.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.constants import TIME_UNIT_S
from cislunar.observation.measurement import DETECTED, EXCLUDED, FAINT, OCCULTED
from cislunar.observation.sensor import ExclusionAngles, Sensor

# %%
# Two sensors: that of the paper, and a smaller telescope with a better baffle.

paper = Sensor()
small = Sensor(
    limiting_magnitude=16.5,
    magnitude_noise=0.05,
    angle_noise_arcsec=2.0,
    exclusion_deg=ExclusionAngles(sun=25.0, moon=5.0, earth=5.0),
)
print(paper)
print(small)

# %%
# For a month, an observer on a near-rectilinear halo orbit observes a target on a larger halo orbit
# every hour.

days = 86_400.0 / TIME_UNIT_S
sky = cs.sample_ephemeris(epoch_jd=2460584.5, duration_days=30.0, step_minutes=60.0)
observer, target = (
    cs.propagate_periodic(orbits.state[0], orbits.period[0], sky.time)[:, :3]
    for orbits in (
        cs.periodic_orbits("Halo_L2_S", period=6.56 * days),
        cs.periodic_orbits("Halo_L2_S", period=13.0 * days),
    )
)

# %%
# Each observation has a detection outcome: detected, too faint, excluded (within an exclusion angle
# of Sun, Moon or Earth) or occulted.

observations = {
    name: cs.sightings(observer, target, sky.sun_position, sensor, radius_m=0.3)
    for name, sensor in (("sensor of the paper", paper), ("small sensor", small))
}
outcomes = {"detected": DETECTED, "too faint": FAINT, "excluded": EXCLUDED, "occulted": OCCULTED}
for name, seen in observations.items():
    shares = ", ".join(
        f"{word} {np.mean(seen.outcome == outcome):.2f}" for word, outcome in outcomes.items()
    )
    print(f"{name}: {shares}")

# %%
# The magnitude is the same for both sensors, the detection outcome is not.

elapsed_days = sky.time / days
figure, panels = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.0), layout="constrained")
for panel, (name, seen), sensor in zip(panels, observations.items(), (paper, small), strict=True):
    for word, outcome in outcomes.items():
        chosen = seen.outcome == outcome
        panel.plot(elapsed_days[chosen], seen.magnitude[chosen], ".", markersize=4, label=word)
    panel.axhline(sensor.limiting_magnitude, color="gray", linestyle="--")
    panel.set(title=name, ylabel="magnitude", ylim=(21.0, 14.0))
panels[0].legend(ncols=4, fontsize="small")
panels[1].set_xlabel("time since the epoch, days")
figure.suptitle("Detection outcomes for a sphere of 0.3 m radius (dashed: limiting magnitude)")

# %%
# ``LoopSettings(sensor=small)`` uses the same sensor in a closed loop, where its noise matters too.
