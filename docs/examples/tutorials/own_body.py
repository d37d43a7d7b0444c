"""
Bodies of your own shape and material
=====================================

How does a target get its own shape and surfaces? They determine its brightness as a function of
attitude. A mesh comes from an OBJ or STL file, or from a few dimensions.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cislunar as cs
from cislunar.photometry.bodies import apparent_body_magnitude, build_body
from cislunar.photometry.materials import FOIL, PAINT, PANEL, Material
from cislunar.photometry.mesh_files import load_mesh
from cislunar.photometry.spacecraft import box_with_wings

# %%
# A mesh file
# -----------
# A box of 2 m by 1 m by 1 m as another program would write it: triangles that face outward and form
# a closed surface. An error in a file is reported with its line number.

box = """\
v -1 -0.5 -0.5
v  1 -0.5 -0.5
v  1  0.5 -0.5
v -1  0.5 -0.5
v -1 -0.5  0.5
v  1 -0.5  0.5
v  1  0.5  0.5
v -1  0.5  0.5
usemtl foil
f 1 4 3
f 1 3 2
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 3 4 8
f 3 8 7
usemtl cells
f 1 5 8
f 1 8 4
f 2 3 7
f 2 7 6
"""
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "box.obj"
    path.write_text(box)
    mesh = load_mesh(path)
print(len(mesh.triangles), "triangles in the groups", sorted(set(mesh.groups)))

# %%
# Surfaces
# --------
# Each group has a material: weights of diffuse and specular reflection, albedo, roughness and
# reflectance. Shadows that facets cast on each other follow from the mesh.

plain = build_body(mesh, {"foil": FOIL, "cells": PANEL})
winged = build_body(box_with_wings(), {"bus": FOIL, "cells": PANEL, "wing": PAINT})

# %%
# Light curves
# ------------
# The bodies make one rotation about the z axis at a range of 50,000 km, with the Sun along x and a
# phase angle of 53 degrees. Glints occur where a facet normal bisects the directions to Sun and
# observer.

turn = np.linspace(0.0, 2.0 * np.pi, 721)
attitude = np.column_stack((0 * turn, 0 * turn, np.sin(turn / 2), np.cos(turn / 2)))
to_sun, to_observer, range_m = [1.0, 0.0, 0.0], [0.6, 0.8, 0.0], 5.0e7
figure, panel = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
for name, body in (("box, foil and cells", plain), ("box with wings", winged)):
    magnitude = apparent_body_magnitude(attitude, to_sun, to_observer, range_m, body)
    print(f"{name}: {magnitude.min():.1f} to {magnitude.max():.1f} mag")
    panel.plot(np.degrees(turn), magnitude, label=name)
panel.invert_yaxis()
panel.set(
    xlabel="angle of rotation, degrees",
    ylabel="magnitude",
    title="Light curves of one rotation, phase angle 53 degrees",
)
panel.grid(alpha=0.3)
panel.legend()

# %%
# Bodies in a closed loop
# -----------------------
# Truth, estimators and bound use these bodies in the same way as the icosahedron, one body for all
# targets or one for each:

surfaces = cs.target_surfaces([winged, plain, plain], Material(), n_targets=3)
print(surfaces.areas.size, "facets of 3 targets,", surfaces.areas.sum() / 3, "m2 on average")
