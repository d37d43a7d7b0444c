"""
Exporting to another tool
=========================

A path of the library as a CCSDS Orbit Ephemeris Message, which GMAT, Orekit and STK read, and back.
How the campaign's cells go out the same way: :doc:`/docs/tutorials/exchange`.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.constants import EPOCH_JD, TIME_UNIT_S
from cislunar.exchange.arcs import COMMENTS, arc, rotating_arc
from cislunar.exchange.inertial import epoch_at
from cislunar.exchange.oem import oem_text, read_oem

# %%
# A halo for one period, each ten minutes, in the rotating frame of the circular problem.

halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
times_s = np.arange(0.0, halo.period[0] * TIME_UNIT_S, 600.0)
path = cs.propagate(halo.state[0], times_s / TIME_UNIT_S)

# %%
# No message can name that frame, so the states are turned into the axes of the ICRF at an epoch,
# about the Earth (or the Moon, or the barycenter), in km and km/s.

epoch = epoch_at(EPOCH_JD)
station = arc("STATION", path, times_s, epoch, object_id="2030-001A", center="EARTH")
message = oem_text([station], created="2030-01-01T00:00:00", comments=COMMENTS)
print("\n".join(line[:88] for line in message.splitlines()[:24]))

# %%
# What is read back is what was written.

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "station.oem"
    file.write_text(message)
    back = read_oem(file)[0]
elapsed_s, state = rotating_arc(back, epoch)
print(f"largest difference: {np.abs(state - path).max():.1e} of the unit of length or speed")

# %%
# The same path in both frames:

figure, (rotating, inertial) = plt.subplots(1, 2, figsize=(8.0, 3.8), layout="constrained")
rotating.plot(path[:, 0], path[:, 1])
rotating.plot(0.98785, 0.0, "o", color="gray", label="Moon")
rotating.set(title="rotating frame", xlabel="x, nondimensional", ylabel="y, nondimensional")
rotating.legend()
inertial.plot(*station.state[:, :2].T / 1e3)
inertial.plot(0.0, 0.0, "o", color="tab:blue", label="Earth")
inertial.set(title="axes of the ICRF, about the Earth", xlabel="x, 1000 km", ylabel="y, 1000 km")
inertial.legend()
for panel in (rotating, inertial):
    panel.set_aspect("equal", adjustable="datalim")
    panel.grid(alpha=0.3)
