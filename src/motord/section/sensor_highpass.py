"""The high-pass of a torque sensor, in the bench file and in the published state."""


class SensorHighpass:
    """What has the high-pass of a torque sensor."""

    highpass_time_constant_s: float

    @property
    def passes_mean(self) -> bool:
        """False for a sensor, piezoelectric for instance, that cannot measure a steady torque."""
        return self.highpass_time_constant_s == 0.0
