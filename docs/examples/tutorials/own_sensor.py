"""
A sensor of one's own
=====================

A telescope is a limiting magnitude, noises, a field of view and the angles it keeps from Sun, Moon
and Earth. What a better one would see is known before any filter runs.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.constants import TIME_UNIT_S
from cislunar.observation.measurement import DETECTED, EXCLUDED, FAINT, OCCULTED
from cislunar.observation.sensor import ExclusionAngles, Sensor

# %%
# Two telescopes: that of the paper, and a smaller one with a better baffle.

paper = Sensor()
small = Sensor(
    limiting_magnitude=16.5,
    magnitude_noise=0.05,
    angle_noise_arcsec=2.0,
    exclusion=ExclusionAngles(sun_deg=25.0, moon_deg=5.0, earth_deg=5.0),
)
print(paper)
print(small)

# %%
# Observer and target for a month: a near-rectilinear halo looks at a larger one.

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
# Each look has a fate: too faint, too near to a bright body, behind one, or detected.

looks = {
    name: cs.sightings(observer, target, sky.sun_position, sensor, radius_m=0.3)
    for name, sensor in (("that of the paper", paper), ("small, well baffled", small))
}
fates = {"detected": DETECTED, "too faint": FAINT, "excluded": EXCLUDED, "occulted": OCCULTED}
for name, seen in looks.items():
    shares = ", ".join(f"{word} {np.mean(seen.fate == fate):.2f}" for word, fate in fates.items())
    print(f"{name}: {shares}")

# %%
# The magnitude is the same for both; what they make of it is not.

elapsed_days = sky.time / days
figure, panels = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.0), layout="constrained")
for panel, (name, seen), sensor in zip(panels, looks.items(), (paper, small), strict=True):
    for word, fate in fates.items():
        chosen = seen.fate == fate
        panel.plot(elapsed_days[chosen], seen.magnitude[chosen], ".", markersize=4, label=word)
    panel.axhline(sensor.limiting_magnitude, color="gray", linestyle="--")
    panel.set(title=name, ylabel="magnitude", ylim=(21.0, 14.0))
panels[0].legend(ncols=4, fontsize="small")
panels[1].set_xlabel("days since the epoch")
figure.suptitle("A sphere of 0.3 m radius; dashed, the faintest that is seen")

# %%
# The same object goes into a closed loop, ``LoopSettings(sensor=small)``, where its noises count
# too.
