"""Force models, and the propagation of states, bundles and state transition matrices."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "bounds": ["check_period", "check_position", "check_velocity", "require_nondimensional"],
    "bundle": ["propagate_bundle", "step_bundle", "step_cloud"],
    "cr3bp": ["CR3BP", "EARTH_MOON", "equations_of_motion", "jacobi_constant", "libration_points",
        "primary_distances", "primary_positions", "pseudo_potential", "variational_matrix",
        "zero_velocity_function"],
    "ephemeris": ["UNITS", "forces_between", "propagate_utc"],
    "ephemeris_forces": ["EphemerisForces"],
    "forces": ["acceleration", "acceleration_change", "at", "is_calm", "of_state", "of_targets",
        "partials", "require_span", "require_targets"],
    "frames": ["BARYCENTER", "earth_moon_axes", "from_inertial", "lunar_frame", "pulsating_frame",
        "recenter", "to_inertial"],
    "instantaneous_frame_cr3bp": ["inertial_states", "is_low_lunar"],
    "maneuvers": ["Impulses", "VELOCITY_UNIT_M_S", "burn_times",
        "local_axes", "propagate_with_impulses"],
    "propagation": ["advance_orbits", "closest_approaches", "propagate", "propagate_many",
        "propagate_periodic", "propagate_stm"],
    "radiation": ["Radiation", "SOLAR_PRESSURE_N_M2", "SUN_RADIUS_KM", "visible_sun"],
    "tableau": ["A8", "ERROR8_3", "ERROR8_5", "STAGES8"],
})
# fmt: on
