"""
Export a trajectory to another tool
===================================

How is a trajectory passed to another tool, such as Orekit? This example writes it as a CCSDS Orbit
Ephemeris Message and reads it back. :doc:`/docs/tutorials/exchange` does the same for cells of the
campaign.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.exchange.arcs import COMMENTS, arc, rotating_arc
from cislunar.exchange.inertial import epoch_at
from cislunar.exchange.oem import oem_text, read_oem

# %%
# The trajectory is one period of a halo orbit in the Earth-Moon rotating frame, every ten minutes.

halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
times_s = np.arange(0.0, halo.period[0] * TIME_UNIT_S, 600.0)
path = cs.propagate(halo.state[0], times_s / TIME_UNIT_S)

# %%
# An Orbit Ephemeris Message cannot name this frame. The states are therefore transformed to the
# ICRF at an epoch, with the Earth (or the Moon, or the barycenter) as center, in km and km/s.

epoch = epoch_at(EPOCH_JD)
station = arc("STATION", path, times_s, epoch, object_id="2030-001A", center="EARTH")
message = oem_text([station], created="2030-01-01T00:00:00", comments=COMMENTS)
print("\n".join(line[:88] for line in message.splitlines()[:24]))

# %%
# Reading the message returns the states that were written.

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "station.oem"
    file.write_text(message)
    back = read_oem(file)[0]
elapsed_s, state = rotating_arc(back, epoch)
print(f"largest difference: {np.abs(state - path).max():.1e} (nondimensional)")

# %%
# The same trajectory in both frames:

figure, (rotating, inertial) = plt.subplots(1, 2, figsize=(8.0, 3.8), layout="constrained")
unit = LENGTH_UNIT_KM / 1e3
rotating.plot(unit * path[:, 0], unit * path[:, 1])
rotating.plot(unit * (1.0 - MU), 0.0, "o", color="gray", label="Moon")
rotating.set(title="Earth-Moon rotating frame", xlabel="x, 1000 km", ylabel="y, 1000 km")
rotating.legend()
inertial.plot(*station.state[:, :2].T / 1e3)
inertial.plot(0.0, 0.0, "o", color="tab:blue", label="Earth")
inertial.set(title="ICRF axes, Earth at the center", xlabel="x, 1000 km", ylabel="y, 1000 km")
inertial.legend()
for panel in (rotating, inertial):
    panel.set_aspect("equal", adjustable="datalim")
    panel.grid(alpha=0.3)
