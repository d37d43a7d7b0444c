"""
Light curves of tumbling bodies
===============================

Apparent magnitude of an icosahedron and of two finer polyhedra with the same rotation, over six
hours at a range of 50,000 km and a phase angle of 53 degrees. The fewer facets a body has, the more
information its light curve contains about the attitude.
"""

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.attitude.quaternion import compose
from cislunar.photometry.shapes import icosphere

hours = np.linspace(0.0, 6.0, 1200)
spin, nutation = np.radians(90.0) * hours, np.radians(25.0) * hours
zeros = np.zeros_like(hours)
attitude = compose(
    np.column_stack((zeros, zeros, np.sin(spin / 2), np.cos(spin / 2))),
    np.column_stack((np.sin(nutation / 2), zeros, zeros, np.cos(nutation / 2))),
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
panel.set(xlabel="time, h", ylabel="magnitude", title="Range 50,000 km, phase angle 53 degrees")
panel.grid(alpha=0.3)
panel.legend()
