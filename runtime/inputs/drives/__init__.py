"""Every data layout, read and written here and nowhere else: `open_drive("KIND:DIR")`, `write_drive(...)`."""

from edgemap.runtime.inputs.drives.camera_yaml import CameraFile
from edgemap.runtime.inputs.drives.drive import Drive, LabelledBoxes
from edgemap.runtime.inputs.drives.locobot import write_locobot
from edgemap.runtime.inputs.drives.open import READERS, open_drive
from edgemap.runtime.inputs.drives.own import write_drive

__all__ = ["READERS", "CameraFile", "Drive", "LabelledBoxes", "open_drive", "write_drive", "write_locobot"]
