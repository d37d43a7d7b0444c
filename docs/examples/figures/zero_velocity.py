"""
Where a mission can go
======================

At a given Jacobi constant a spacecraft cannot cross the surface on which its speed would be zero.
The paper's static targets fill what is left about the Moon.
"""

import matplotlib.pyplot as plt
import numpy as np

from cislunar.dynamics.cr3bp import jacobi_constant, libration_points, zero_velocity_function

points = libration_points()
x, y = np.meshgrid(np.linspace(-1.4, 1.4, 500), np.linspace(-1.2, 1.2, 430))
place = np.stack([x, y, np.zeros_like(x)], axis=-1)

figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.3), sharey=True, layout="constrained")
for panel, constant in zip(panels, (3.19, 3.10, 3.00), strict=True):
    panel.contourf(x, y, zero_velocity_function(place, constant), [-9.0, 0.0], colors=["0.75"])
    panel.plot(points[:, 0], points[:, 1], "+", color="black", markersize=8)
    panel.plot([-0.01215, 0.98785], [0.0, 0.0], "o", color="tab:blue", markersize=4)
    panel.set(title=f"Jacobi constant {constant:.2f}", xlabel="x", aspect="equal")
panels[0].set_ylabel("y")
figure.suptitle("Forbidden (gray), libration points (+), Earth and Moon (dots)")

at_rest = jacobi_constant(np.hstack([points, np.zeros((5, 3))]))
for number, constant in enumerate(at_rest, start=1):
    print(f"L{number} opens at {constant:.4f}")
