"""
A closed loop of one's own
==========================

Two telescopes, four targets, twelve hours: who looks where is decided every hour, and a filter
makes of the looks where the targets are and how they are turned.

How attitude is estimated: :doc:`/docs/attitude`. The bound: :doc:`/docs/bound`.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.constants import LENGTH_UNIT_KM, TIME_UNIT_S
from cislunar.photometry.materials import Material
from cislunar.tasking.settings import LoopSettings

# %%
# The settings come first, for they say at which times everything must be known: a measurement each
# minute, a decision each hour. What is not given is the paper's.

settings = LoopSettings(duration_hours=12.0, interval_minutes=60.0)
times = settings.elapsed_s / TIME_UNIT_S

# %%
# Observers
# ---------
# One on the near-rectilinear halo of 6.56 days beyond the Moon, one on a halo before it. The Sun
# comes from the planetary ephemeris.

days = 86_400.0 / TIME_UNIT_S
observers = [
    cs.periodic_orbits("Halo_L2_S", period=6.56 * days),
    cs.periodic_orbits("Halo_L1_N", period=9.5 * days),
]
for orbits in observers:
    print(orbits.family[0], "perilune", orbits.perilune_km.round(), "km")

tracks = np.stack([cs.propagate_periodic(o.state[0], o.period[0], times)[:, :3] for o in observers])
sun = cs.sample_ephemeris(epoch_jd=2460584.5, duration_days=0.5, step_minutes=1.0)
scene = cs.make_scene(tracks, sun.sun_position, settings.step_s)

# %%
# Targets
# -------
# Four places of one L2 halo, a quarter of a period apart. Each is an icosahedron of 2 m radius; any
# convex shape and any material will do. Light falls with 1/r^2; the law that the paper prints,
# which makes targets 2.75 mag fainter, is `cislunar.photometry.materials.PRINTED`, a fourth
# argument.

halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
start = cs.propagate(halo.state[0], halo.period[0] * np.arange(4) / 4)
surfaces = cs.target_surfaces(cs.icosahedron(2.0), Material(), n_targets=4)

# %%
# The loop
# --------
# The seed is that of truth and noise; several seeds make a sample of runs.

result = cs.run_closed_loop(scene, surfaces, start, np.arange(4), seeds=[1], settings=settings)
print("looks used of each target:", result.valid[0].sum(axis=0))
print("first taskings, target of each observer:", *result.assignment[0, :4].tolist())

# %%
# What came of it
# ---------------
# Errors, three standard deviations and the Cramér-Rao bound have one layout: three components each
# of attitude, angular velocity, position and velocity.

hours = result.elapsed_s / 3600.0
parts = {
    "position, km": (slice(6, 9), LENGTH_UNIT_KM),
    "attitude, degrees": (slice(0, 3), 180.0 / np.pi),
}
figure, panels = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.5), layout="constrained")
for panel, (label, (part, unit)) in zip(panels, parts.items(), strict=True):
    for target in range(4):
        error = unit * np.linalg.norm(result.error[0, :, target, part], axis=1)
        bound = unit * np.linalg.norm(result.bound[0, :, target, part], axis=1)
        (line,) = panel.semilogy(hours, error, label=f"target {target}")
        panel.semilogy(hours, bound, color=line.get_color(), linestyle=":")
    panel.set_ylabel(f"error of {label}")
    panel.grid(alpha=0.3)
panels[0].legend(ncols=4, fontsize="small")
panels[1].set_xlabel("hours since the epoch")
figure.suptitle("Errors (solid) and what no unbiased estimator can beat (dotted)")

# %%
# A target that nobody sees keeps the error it began with. ``estimator="batch"`` takes the other
# estimator; ``settings.record`` keeps truth, estimates and looks.
