"""Apparent magnitudes of spheres, convex faceted bodies, and bodies that shadow themselves."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "bodies": ["Body", "apparent_body_magnitude", "build_body", "plain_body"],
    "body_blocks": ["body_magnitude", "body_magnitude_derivatives", "body_magnitude_deviations",
        "body_magnitude_gradients", "body_magnitudes", "one_geometry"],
    "facet_blocks": ["BLOCK_ROWS", "LANES", "MAGNITUDE", "QUATERNION", "RANGE", "SUN", "TURN",
        "VIEW"],
    "facet_derivatives": ["facet_magnitude_derivatives"],
    "facets": ["FLOOR_MAGNITUDE", "apparent_magnitude", "facet_irradiance", "facet_magnitude",
        "facet_sums", "fresnel_reflectance"],
    "law_mixture": ["COOK_TORRANCE"],
    "materials": ["ALBEDO", "AXIS_SCALE", "FACET", "FOIL", "IRRADIANCE_LAWS",
        "LOMMEL_SEELIGER_SHARE", "Material", "NOTHING", "PAINT", "PANEL", "PHASE_CURVATURE",
        "PHASE_SLOPE", "PHONG_SHARE", "PRINTED", "PhotometryModel", "PhotometryReading",
        "REFLECTANCE", "REFLECTION_LAWS", "Reflection", "SCALE", "SHARE", "SLOPE", "TABULATED",
        "group_materials", "material_of", "material_rows"],
    "mesh_files": ["load_mesh"],
    "meshes": ["Mesh"],
    "parameter_deviations": ["deviation_rows", "perturbed_body", "with_law"],
    "shapes": ["Facets", "facets_from_triangles", "icosahedron", "icosahedron_mesh", "icosphere",
        "scale_axes", "scale_to_sphere"],
    "spacecraft": ["MODELS", "SURFACES", "box_with_wings"],
    "sphere": ["equal_sphere_coefficient", "faintness_per_squared_range", "phase_angle",
        "phase_function", "returned_light", "sphere_magnitude"],
})
# fmt: on
