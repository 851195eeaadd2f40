"""Readout time of a rolling shutter, which exposes a picture's rows one after the other."""

from dataclasses import dataclass

UNKNOWN_S = 0.02  # standard deviation before any measurement (phones and webcams 10 to 33 ms, a global shutter 0)


@dataclass(frozen=True, slots=True)
class Readout:
    """time_s: from the first row to the last, negative where the picture is upside down. information: of it, s^-2."""

    time_s: float = 0.0
    information: float = UNKNOWN_S**-2

    def updated(self, time_s: float, information: float, share: float) -> "Readout":
        """Kalman update. time_s: estimate that has this one as its prior; information: what its measurements add to
        the prior, of which only a share is new."""
        if information <= 0.0:
            return self
        gained = share * information
        measured_s = self.time_s + (time_s - self.time_s) * (1.0 + self.information / information)
        mean_s = self.time_s + gained / (self.information + gained) * (measured_s - self.time_s)
        return Readout(mean_s, self.information + gained)
