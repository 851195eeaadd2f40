"""`make release-check`: what a release must be, checked from the archives alone, as a user gets them.

Source archive and wheel are built twice with the time of the last commit: their sums are the same both times. The
archives hold what is committed. The wheel, made from the source archive, is at most 20 MB; installed in a clean
environment it runs the demo's first frames. Prints sizes. --extras: each extra alone in an environment of its own.
"""

import argparse
import gzip
import hashlib
import io
import os
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
WHEEL_BYTES = 20_000_000  # bundles 12.0, demo 2.1, heads for export 2.0, furniture of simulated homes 2.5
LEFT_OUT = ("export", "all", "dev")  # torch: gigabytes, and another build of it for every processor


@cache
def last_commit() -> tuple[str, str]:
    """Hash and time of the last commit; one that comes while this runs is not built."""
    line = subprocess.run(
        ["git", "log", "-1", "--format=%H %ct"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    name, stamp_s = line.split()
    return name, stamp_s


def built(folder: Path) -> dict[str, str]:
    """Builds both archives of the last commit: SHA-256 by name. Members have the commit's time and no owner."""
    folder.mkdir(parents=True, exist_ok=True)
    commit, stamp_s = last_commit()
    environment = os.environ | {"SOURCE_DATE_EPOCH": stamp_s, "PYTHONHASHSEED": "0"}
    with tempfile.TemporaryDirectory(prefix="edgemap-source-") as source:
        tree = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True).stdout
        subprocess.run(["tar", "-x", "-C", source], input=tree, check=True)
        command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), source]
        subprocess.run(command, env=environment, capture_output=True, check=True)
    for archive in folder.glob("*.tar.gz"):
        _normalise(archive, int(stamp_s))
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


def _normalise(archive: Path, stamp_s: int) -> None:
    """The same members in the order of their names, without the time and the user of this build."""
    with tarfile.open(archive) as before:
        members = sorted(before.getmembers(), key=lambda member: member.name)
        data = io.BytesIO()
        with tarfile.open(fileobj=data, mode="w", format=tarfile.PAX_FORMAT) as after:
            for member in members:
                member.mtime, member.uid, member.gid, member.uname, member.gname = stamp_s, 0, 0, "", ""
                member.pax_headers = {}
                after.addfile(member, before.extractfile(member) if member.isfile() else None)
    archive.write_bytes(gzip.compress(data.getvalue(), mtime=stamp_s))


def installed(folder: Path, what: str) -> tuple[Path, int]:
    """An environment with that alone; its `edgemap`, and its size in bytes."""
    venv.create(folder, with_pip=True)
    constraints = ["-c", str(ROOT / "constraints.txt")]
    pip = [str(folder / "bin/python"), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    subprocess.run([*pip, *constraints, what], check=True)
    subprocess.run([str(folder / "bin/python"), "-m", "pip", "uninstall", "-q", "-y", "pip", "setuptools"], check=True)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return folder / "bin/edgemap", size


def main() -> None:
    """Check, print, and end with 1 where something is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--extras", action="store_true")
    parser.add_argument("--build", type=Path, metavar="DIR", help="only build, into this folder")
    chosen = parser.parse_args()
    if chosen.build:
        print("\n".join(f"{total}  {name}" for name, total in built(chosen.build).items()))
        return
    with tempfile.TemporaryDirectory(prefix="edgemap-release-") as temporary:
        folder = Path(temporary)
        first, second = built(folder / "first"), built(folder / "second")
        wrong = [f"{name}: two builds differ" for name, total in first.items() if second.get(name) != total]
        for name, total in first.items():
            print(f"{name}  {(folder / 'first' / name).stat().st_size:,} bytes  sha256 {total}")
        wheel = next((folder / "first").glob("*.whl"))
        if wheel.stat().st_size > WHEEL_BYTES:
            wrong.append(f"{wheel.name}: {wheel.stat().st_size:,} bytes, at most {WHEEL_BYTES:,}")
        edgemap, size = installed(folder / "base", str(wheel))
        print(f"base install: {size / 1e6:.0f} MB")
        run = [edgemap, "run", "--frames", "30", "--out", folder / "run"]
        ended = subprocess.run([str(word) for word in run], cwd=folder, capture_output=True, text=True)
        print(ended.stdout.splitlines()[0] if ended.stdout else ended.stderr)
        if ended.returncode or not (folder / "run" / "report.html").is_file():
            wrong.append(f"the demo from the wheel: exit code {ended.returncode}")
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        for extra in sorted(set(extras) - set(LEFT_OUT)) if chosen.extras else ():
            edgemap, size = installed(folder / extra, f"{wheel}[{extra}]")
            ended = subprocess.run([str(edgemap), "doctor"], cwd=folder, capture_output=True, text=True)
            print(f"with {extra}: {size / 1e6:.0f} MB, doctor ends with {ended.returncode}")
            if "Traceback" in ended.stderr:
                wrong.append(f"extra {extra}: {ended.stderr.splitlines()[-1]}")
    print("\n".join(wrong) or "the release is as it must be")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
