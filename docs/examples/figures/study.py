"""
A study of user-defined telescopes and targets
==============================================

How well do two telescopes track three objects? A study simulates tasking and tracking of the given
targets by the given observers. The figure shows the position error and its standard deviation over
six hours. The page :doc:`/docs/tutorials/own_study` describes the arguments.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs

study = cs.Study(
    observers={"north": "Halo_L1_N,period=9.5", "south": "Halo_L2_S,period=6.56"},
    targets={"relay": "Lyap_L2,period=15", "fleet": {"family": "Halo_L2_S", "count": 2}},
    epoch="2027-03-01T00:00:00",
    sensor=cs.Sensor(limiting_magnitude=19, angle_noise_arcsec=2, field_of_view_deg=2),
    duration_hours=6,
)
result = study.run()
print(result.summary()[["measurements", "position_error_km", "position_sigma_km"]].round(2))

# %%
# Dates, names and units are those of the labeled arrays. `result.plot` draws ready-made figures.

data = result.to_xarray().isel(seed=0)
figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for number, name in enumerate(data["target"].values):
    for key, line, words in (("error", "-", "error"), ("sigma", ":", "standard deviation")):
        length = np.linalg.norm(data[f"position_{key}"].sel(target=name), axis=-1)
        panel.semilogy(data["time"], length, line, color=f"C{number}", label=f"{name}, {words}")
panel.set(xlabel="date, UTC", ylabel="position, km")
panel.grid(alpha=0.3)
panel.legend(fontsize="small")
