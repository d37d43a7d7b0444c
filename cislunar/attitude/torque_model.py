"""Settings of a torque that varies. No function here needs compiled kernels."""

from cislunar.runtime.settings_fields import NotNegative, Positive, Section, setting

# fmt: off


class TorqueModel(Section):
    """Varying torques on the targets; see `cislunar.attitude.varying_torque`."""

    center_of_pressure_sigma_m: NotNegative = setting(
        "standard deviation, along each body axis, of the point on which the sunlight acts, "
        "relative to the center of mass; 0: no torque of sunlight", "m", default=0)
    mass_kg: Positive = setting(
        "mass of a target, whose inertia is that of a homogeneous sphere of its surface area with "
        "the ratios of its moments; for the torque of sunlight", "kg", default=300)
    random_deg_h2: NotNegative = setting(
        "standard deviation, about each body axis, of the angular acceleration by a random torque",
        "deg/h^2", default=0)
    random_hours: Positive = setting(
        "time in which the correlation of the random torque decays by a factor e", "h", default=3)

    # fmt: on

    def __bool__(self) -> bool:
        """Whether there is such a torque."""
        return self.center_of_pressure_sigma_m > 0.0 or self.random_deg_h2 > 0.0
