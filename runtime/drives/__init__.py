"""Every data layout, read and written here and nowhere else: `open_drive("KIND:DIR")`, `write_drive(...)`."""

from edgemap.runtime.drives.write import write_drive

__all__ = ["write_drive"]
