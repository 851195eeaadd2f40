"""What tests of the runtime share."""

import subprocess

import pytest


@pytest.fixture
def small_disk(request, tmp_path):
    """A file system of its own, of 64 KiB or what the test's module says in DISK_KIB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    size = f"size={getattr(request.module, 'DISK_KIB', 64)}k"
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(disk)], capture_output=True, text=True)
    if made.returncode:
        pytest.skip(f"no tmpfs can be mounted here: {made.stderr.strip()}")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)
