"""Observation of targets: scene, line of sight, measurement, derivatives, sensors, bodies."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "body_factory": ["body_from_spec", "equal_sphere_of"],
    "body_parameters": ["BodyParameterPrior", "HOUR", "REFLECTION_LAW", "require_freedom"],
    "body_sampling": ["sample_rotations", "sample_surfaces", "surface_table", "true_deviations"],
    "body_spec": ["BodySpec", "ICOSAHEDRON", "bodies_of_targets", "load_body_table"],
    "ground": ["station_positions", "station_tracks"],
    "measurement": ["DETECTED", "EXCLUDED", "FAINT", "NOT_TASKED", "OCCULTED", "detectable_targets",
        "measure", "observe"],
    "measurement_derivatives": ["angle_rows", "deviation_row", "measurement_rows"],
    "records": ["Measurements", "Schedule", "arranged", "highest", "no_measurements",
        "pointed_schedule", "rows_of"],
    "scene": ["Scene", "make_scene", "require_measurements"],
    "sensor": ["ARCSECOND", "Atmosphere", "ExclusionAngles", "GroundSensor", "PhotonNoise",
        "Sensor", "SensorLimits", "Sensors", "extinction", "limits_of", "noise_at",
        "noise_variance_at", "sensor_limits", "sensors_of"],
    "sightline": ["CLEAR", "EARTH_RADIUS", "METERS", "MOON_RADIUS", "SUN", "angles_of_vectors",
        "dimming", "direction_angles", "in_clear_view", "inside_primary", "lit_directions",
        "obstacle", "outside_exclusion", "sphere_brighter", "sphere_margin",
        "sunlit_share", "sunlit_share_at", "toward_primary", "unit_vectors", "wrap_angle",
        "wrapped"],
    "target_surfaces": ["TargetSurfaces", "body_of", "joined_surfaces", "surfaces_of"],
})
# fmt: on
