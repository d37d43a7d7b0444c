"""
A light curve and its bodies
============================

The same tumble of an icosahedron and of finer spheres: the fewer the facets, the more a light curve
tells of attitude.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.attitude.quaternion import compose
from cislunar.photometry.shapes import icosphere

hours = np.linspace(0.0, 6.0, 1200)
spin, nod = np.radians(90.0) * hours, np.radians(25.0) * hours
zeros = np.zeros_like(hours)
attitude = compose(
    np.column_stack((zeros, zeros, np.sin(spin / 2), np.cos(spin / 2))),
    np.column_stack((np.sin(nod / 2), zeros, zeros, np.cos(nod / 2))),
)

figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for name, facets in (
    ("icosahedron, 20 facets", cs.icosahedron(1.0)),
    ("80 facets", icosphere(1, 1.0)),
    ("320 facets", icosphere(2, 1.0)),
):
    magnitude = cs.apparent_magnitude(attitude, [1.0, 0.0, 0.0], [0.6, 0.8, 0.0], 5.0e7, facets)
    panel.plot(hours, magnitude, label=name)
panel.invert_yaxis()
panel.set(xlabel="hours", ylabel="magnitude", title="Range 50 000 km, phase angle 53 degrees")
panel.grid(alpha=0.3)
panel.legend()
