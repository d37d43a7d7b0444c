"""Attitude parameters and rigid-body rotation."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "attitude_integrator": ["TURN_OF_LONG_STEP", "carry_rotation", "torque_free_step"],
    "grp": ["GRP_A", "GRP_F", "from_quaternion", "grp_from_quaternion_components",
        "pull_back_to_grp", "quaternion_from_grp_components", "to_quaternion"],
    "inertia": ["INERTIA", "RigidBodies", "TORQUE", "inertia_matrix", "rigid_bodies"],
    "parameter_deviations": ["TRACK_COLUMNS", "FIRST_DEVIATION", "TURN_IF_KNOWN", "TURN_PER_STEP",
        "begin_track", "ends_of", "extend_track", "make_track", "parameter_transition",
        "perturbed_rotation", "weigh_ends"],
    "quaternion": ["attitude_matrix", "compose", "from_rotation_vector", "multiply_components",
        "normalize", "rotate_components", "rotation_vector_components", "to_body",
        "to_inertial"],
    "rigid_body": ["matrix_times", "propagate_attitudes", "propagate_spherical",
        "spherical_transition"],
    "torque_model": ["TorqueModel"],
    "varying_torque": ["RandomTorque", "SunPressure", "propagate_varying"],
})
# fmt: on
