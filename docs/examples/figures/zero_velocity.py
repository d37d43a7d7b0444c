"""
Zero-velocity curves
====================

Where can a spacecraft with a given Jacobi constant go? It cannot cross the surface on which its
speed in the rotating frame would be zero. The figure shows the forbidden region in the plane of
Earth and Moon for three Jacobi constants (nondimensional). The static targets of the paper fill the
accessible region around the Moon.
"""

import matplotlib.pyplot as plt
import numpy as np

from cislunar.constants import LENGTH_UNIT_KM, MU
from cislunar.dynamics.cr3bp import jacobi_constant, libration_points, zero_velocity_function

points = libration_points()
x, y = np.meshgrid(np.linspace(-1.4, 1.4, 500), np.linspace(-1.2, 1.2, 430))
position = np.stack([x, y, np.zeros_like(x)], axis=-1)
unit = LENGTH_UNIT_KM / 1e3

figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.3), sharey=True, layout="constrained")
for panel, constant in zip(panels, (3.19, 3.10, 3.00), strict=True):
    forbidden = zero_velocity_function(position, constant)
    panel.contourf(unit * x, unit * y, forbidden, [-9.0, 0.0], colors=["0.75"])
    panel.plot(unit * points[:, 0], unit * points[:, 1], "+", color="black", markersize=8)
    panel.plot([-unit * MU, unit * (1.0 - MU)], [0.0, 0.0], "o", color="tab:blue", markersize=4)
    panel.set(title=f"Jacobi constant {constant:.2f}", xlabel="x, 1000 km", aspect="equal")
panels[0].set_ylabel("y, 1000 km")
figure.suptitle("Forbidden region (gray), libration points (+), Earth and Moon (dots)")

at_rest = jacobi_constant(np.hstack([points, np.zeros((5, 3))]))
for number, constant in enumerate(at_rest, start=1):
    print(f"Jacobi constant at rest at L{number}: {constant:.4f}")
