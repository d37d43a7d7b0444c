"""
Families of periodic orbits
===========================

Six families of the candidate observer orbits with seven members each, colored by stability index. A
position error on an orbit of index 1 does not grow exponentially, whereas on an orbit of index 1000
it grows by about a factor of 2000 in each period. Halo and butterfly families are projected on the
y-z plane, planar families on the x-y plane of the Earth-Moon rotating frame.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

import cislunar as cs
from cislunar.constants import LENGTH_UNIT_KM, MU

spatial = ("Halo_L1_N", "Halo_L2_S", "Butterfly_N")
planar = ("Lyap_L1", "Lyap_L2", "Lyap_L3")
library = cs.observer_library(dict.fromkeys(spatial + planar, 7))
unit = LENGTH_UNIT_KM / 1e3
color, norm = plt.get_cmap("viridis_r"), LogNorm(1.0, library.stability_index.max())

figure, panels = plt.subplots(2, 3, figsize=(8.0, 5.4), layout="constrained")
for panel, name in zip(panels.flat, spatial + planar, strict=True):
    right, up = (1, 2) if name in spatial else (0, 1)
    for k in np.flatnonzero(library.family == name):
        path = unit * cs.propagate(library.state[k], np.linspace(0.0, library.period[k], 400))
        panel.plot(path[:, right], path[:, up], color=color(norm(library.stability_index[k])))
    panel.plot((unit * (1.0 - MU), 0.0)[right], 0.0, "o", color="gray", markersize=5)
    if name in planar:
        panel.plot(-unit * MU, 0.0, "o", color="tab:blue", markersize=7)
    panel.set(title=name, xlabel=f"{'xyz'[right]}, 1000 km", ylabel=f"{'xyz'[up]}, 1000 km")
    panel.set_aspect("equal", adjustable="datalim")
figure.colorbar(plt.cm.ScalarMappable(norm, color), ax=panels, label="stability index", shrink=0.8)
figure.suptitle("Earth-Moon rotating frame with Earth (blue) and Moon (gray)")
