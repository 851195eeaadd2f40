"""Large documents are refused in bounded memory. Before tests with torch: a worker that held it was killed here."""

import subprocess
import sys

MEMORY = """
import resource, sys
from pathlib import Path
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.step.map_file import load_map
from edgemap.runtime.inputs.drives.truth import read_boxes
from edgemap.runtime.inputs.recordings.facts import read_trajectory_file
size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + (400 << 20),) * 2)
path, empties = Path(sys.argv[1]), b"{}," * (5 << 20)
for text, read in (
    (b'{"format":[' + empties + b'1],"objects":[]}', load_map),
    (b'{"format":"edgemap.map/1","objects":[{"id":3}],"x":[' + empties + b"1]}", load_map),
    (b'{"frames":[' + empties + b"1]}", read_boxes),
    (b"[" + empties + b"1]", lambda path: read_trajectory_file(path.read_bytes(), "truth.json")),
):
    path.write_bytes(text)
    try:
        read(path)
    except EdgemapError as error:
        print(error)
"""


def test_what_is_wrong_in_a_large_document_is_told_without_reading_all_of_it_as_any_values(tmp_path):
    """15 MB of `{}` are 400 MB once they are Python's dictionaries."""
    done = subprocess.run(
        [sys.executable, "-c", MEMORY, str(tmp_path / "x.json")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-400:]
    assert len(done.stdout.splitlines()) == 4
