"""
Exchange observations with another tool
=======================================

How are directions and magnitudes passed to an orbit determination program, and how are observations
from another program read? This example writes them as a CCSDS Tracking Data Message and in the
format of the Minor Planet Center (ADES), and reads them back. :doc:`/docs/tutorials/exchange` does
the same for cells of the campaign.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import cislunar as cs
from cislunar.constants import EPOCH_JD, TIME_UNIT_S
from cislunar.exchange import (
    ades_text,
    arc,
    epoch_at,
    observation_dates,
    oem_text,
    read_ades,
    read_tdm,
    tdm_text,
)

# %%
# A telescope on a halo orbit observes an object on a Lyapunov orbit every ten minutes for a day.
# Both paths are transformed to the ICRF, with the Earth as center.

times_s = np.arange(0.0, 86_400.0, 600.0)
epoch = epoch_at(EPOCH_JD)
telescope, target = (
    arc(name, cs.propagate(orbit.state[0], times_s / TIME_UNIT_S), times_s, epoch)
    for name, orbit in (
        ("TELESCOPE", cs.periodic_orbits("Halo_L2_S", jacobi=3.05)),
        ("TARGET", cs.periodic_orbits("Lyap_L1", jacobi=3.1)),
    )
)

# %%
# The table of observations has the column names of ADES. Each row has the position of the
# telescope, whose code O001 stands for no observatory.

way = target.state[:, :3] - telescope.state[:, :3]
rng = np.random.default_rng(1)
noise_deg = rng.normal(0.0, 2.0 / 3600.0, (2, times_s.size))
dec = np.degrees(np.arcsin(way[:, 2] / np.linalg.norm(way, axis=1)))
table = pd.DataFrame(
    {
        "stn": "O001",
        "artSat": "TARGET",
        "obsTime": observation_dates(target.tdb_s),
        "ra": np.degrees(np.arctan2(way[:, 1], way[:, 0])) + noise_deg[0] / np.cos(np.radians(dec)),
        "dec": dec + noise_deg[1],
        "rmsRA": 2.0,
        "rmsDec": 2.0,
        "mag": rng.normal(15.0, 0.05, times_s.size),
        "rmsMag": 0.05,
        "sys": "ICRF_KM",
        "ctr": "399",
        **{f"pos{k + 1}": telescope.state[:, k] for k in range(3)},
    }
)
table["ra"] %= 360.0

# %%
# The Tracking Data Message names the file with the ephemeris of the telescope, an OEM.

message = tdm_text(table, created="2030-01-01T00:00:00", ephemerides={"O001": "telescope.oem"})
ephemeris = oem_text([telescope], created="2030-01-01T00:00:00")
print("\n".join(message.splitlines()[:19]))

# %%
# The ADES file also has the standard deviations and the position of the telescope. Its numbers have
# the digits that the standard allows.

print("\n".join(line[:95] for line in ades_text(table).splitlines()[:4]))

# %%
# Both files are read back as tables with the same column names.

with tempfile.TemporaryDirectory() as folder:
    tdm, psv = Path(folder) / "telescope.tdm", Path(folder) / "telescope.psv"
    tdm.write_text(message)
    psv.write_text(ades_text(table))
    back, rounded = read_tdm(tdm), read_ades(psv)
print(f"largest difference: {np.abs(back['ra'] - table['ra']).max():.1e} deg (TDM),")
print(f"                    {np.abs(rounded['ra'] - table['ra']).max():.1e} deg (ADES)")

figure, panel = plt.subplots(figsize=(6.5, 3.8), layout="constrained")
points = panel.scatter(back["ra"], back["dec"], c=times_s / 3600.0, s=12)
panel.set(xlabel="right ascension, deg", ylabel="declination, deg")
panel.grid(alpha=0.3)
figure.colorbar(points, label="time, h")
