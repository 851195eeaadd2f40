"""Errors of attitudes, and their sources."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from edgemap.geometry.camera.attitude import Attitude
from edgemap.geometry.se2 import wrap_angle


def attitude_figures(estimated: Sequence[Attitude | None], true: Sequence[Attitude] | None) -> dict[str, Any]:
    """`sources`: share of the frames in which each provided the attitude. Against true ones, where available:
    `pitch_rms_deg`, `roll_rms_deg`, `max_deg`, and `nees` (2 on average where consistent); else null.
    """
    names = Counter("none" if attitude is None else attitude.source for attitude in estimated)
    sources = {name: round(count / len(estimated), 4) for name, count in names.most_common()}
    errors, scaled = [], []
    for own, reference in zip(estimated, true or (), strict=False):
        if own is None:
            continue
        off_rad = own.roll_rad - reference.roll_rad, own.pitch_rad - reference.pitch_rad
        error = np.array([wrap_angle(value) for value in off_rad])
        errors.append(error)
        scaled.append(float(error @ np.linalg.pinv(own.covariance_rad2) @ error))
    if not errors:
        return {"sources": sources, "pitch_rms_deg": None, "roll_rms_deg": None, "max_deg": None, "nees": None}
    degrees = np.degrees(np.array(errors))
    roll, pitch = np.sqrt((degrees**2).mean(axis=0)).tolist()
    largest = float(np.abs(degrees).max())
    return {
        "sources": sources, "pitch_rms_deg": pitch, "roll_rms_deg": roll, "max_deg": largest,
        "nees": float(np.mean(scaled)),
    }  # fmt: skip
