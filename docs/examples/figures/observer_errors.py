"""
Telescopes whose pointing has an error
======================================

The zero points of both angles of each telescope have an unknown error of about 20 arcsec, ten times
the noise of a measurement. An estimator that ignores it is overconfident. Calibration estimates the
errors of the telescopes from the measurements of all targets (:doc:`/docs/observers`). The figure
shows the mean position error and standard deviation of six targets.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs

given = {
    "observers": {"north": "Halo_L1_N,period=9.5", "south": "Halo_L2_S,period=6.56"},
    "targets": {"fleet": {"family": "Halo_L2_S", "count": 6}},
    "epoch": "2027-03-01T00:00:00",
    "sensor": cs.Sensor(limiting_magnitude=19, angle_noise_arcsec=2),
    "estimator": "mukf",
    "duration_hours": 12,
}
figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for treatment, color in (("none", "C1"), ("calibrated", "C0")):
    errors = {"pointing_arcsec": 20, "treatment": treatment}
    data = cs.Study(**given, observer_errors=errors).run().to_xarray()
    for key, line, words in (("error", "-", "error"), ("sigma", ":", "standard deviation")):
        length = np.linalg.norm(data[f"position_{key}"].isel(seed=0), axis=-1).mean(axis=1)
        panel.semilogy(data["time"], length, line, color=color, label=f"{words}, {treatment}")
panel.set(xlabel="date, UTC", ylabel="position, km")
panel.grid(alpha=0.3)
panel.legend(fontsize="small", title="treatment of pointing errors")
