"""Settings of varying torques. No function here needs compiled kernels."""

from cislunar.runtime.settings_fields import NotNegative, Positive, Section, setting

# fmt: off


class TorqueModel(Section):
    """Varying torques on the targets; see `cislunar.attitude.varying_torque`."""

    center_of_pressure_sigma_m: NotNegative = setting(
        "standard deviation, along each body axis, of the center of pressure of sunlight relative "
        "to the center of mass; 0: no torque of sunlight", "m", default=0)
    mass_kg: Positive = setting(
        "mass of a target for the torque of sunlight; the mean of its moments of inertia is that "
        "of a homogeneous sphere of its surface area, with the ratios of its own moments", "kg",
        default=300)
    random_deg_h2: NotNegative = setting(
        "standard deviation, about each body axis, of the angular acceleration by a random torque",
        "deg/h^2", default=0)
    random_hours: Positive = setting(
        "time in which the correlation of the random torque decays by a factor e", "h", default=3)

    # fmt: on

    def __bool__(self) -> bool:
        """Whether there is a varying torque."""
        return self.center_of_pressure_sigma_m > 0.0 or self.random_deg_h2 > 0.0
