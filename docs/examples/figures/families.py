"""
Families of orbits
==================

Six of the families that observers are chosen from, colored by stability index: an error on an orbit
of index 1 stays, on one of index 1000 it grows a thousandfold in each period.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

import cislunar as cs

spatial = ("Halo_L1_N", "Halo_L2_S", "Butterfly_N")
planar = ("Lyap_L1", "Lyap_L2", "Lyap_L3")
library = cs.observer_library(dict.fromkeys(spatial + planar, 7))
color, norm = plt.get_cmap("viridis_r"), LogNorm(1.0, library.stability_index.max())

figure, panels = plt.subplots(2, 3, figsize=(8.0, 5.4), layout="constrained")
for panel, name in zip(panels.flat, spatial + planar, strict=True):
    right, up = (1, 2) if name in spatial else (0, 1)
    for k in np.flatnonzero(library.family == name):
        path = cs.propagate(library.state[k], np.linspace(0.0, library.period[k], 400))
        panel.plot(path[:, right], path[:, up], color=color(norm(library.stability_index[k])))
    panel.plot((0.98785, 0.0, 0.0)[right], 0.0, "o", color="gray", markersize=5)
    if name in planar:
        panel.plot(-0.01215, 0.0, "o", color="tab:blue", markersize=7)
    panel.set(title=name, xlabel="xyz"[right], ylabel="xyz"[up])
    panel.set_aspect("equal", adjustable="datalim")
figure.colorbar(plt.cm.ScalarMappable(norm, color), ax=panels, label="stability index", shrink=0.8)
figure.suptitle("Rotating frame, in distances of Earth (blue) and Moon (gray)")
