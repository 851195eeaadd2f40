#!/bin/sh
# The base wheel on Debian's arm64 userland, which QEMU runs: its install, its size, and the demo's first 30 frames against
# the same on this processor. As root, on Debian or Ubuntu; a quarter of an hour. Usage: scripts/aarch64_demo.sh WHEEL [DIR]
set -eu
# In a mount namespace of its own, whose mounts end with it.
[ "${EDGEMAP_UNSHARED:-}" ] || exec env EDGEMAP_UNSHARED=1 unshare --mount "$0" "$@"
wheel=$(readlink -f "$1")
root=${2:-/var/tmp/edgemap-arm64}
cd "$(dirname "$0")/.."
scripts/system-packages qemu-user-static debootstrap
binfmt=/proc/sys/fs/binfmt_misc
[ -e $binfmt/register ] || mount -t binfmt_misc binfmt_misc $binfmt
if [ ! -e $binfmt/qemu-aarch64 ]; then  # ELF of 64 bits for this processor; F: QEMU is opened now, outside the root
    printf '%s' ':qemu-aarch64:M::\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00:\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff:/usr/bin/qemu-aarch64-static:F' > $binfmt/register
fi
if [ ! -x "$root/usr/bin/python3" ]; then
    debootstrap --arch=arm64 --foreign --variant=minbase --include=python3,python3-pip,python3-venv,ca-certificates bookworm "$root"
    chroot "$root" /debootstrap/debootstrap --second-stage
fi
# onnxruntime reads the processor from here: what this one has makes it crash, what a Cortex-A76 has does not.
mount -t proc proc "$root/proc"
for core in 0 1; do
    printf 'processor\t: %s\nFeatures\t: fp asimd aes pmull sha1 sha2 crc32 atomics fphp asimdhp asimdrdm lrcpc asimddp\n' $core
    printf 'CPU implementer\t: 0x41\nCPU architecture: 8\nCPU variant\t: 0x4\nCPU part\t: 0xd0b\nCPU revision\t: 1\n\n'
done > "$root/root/cpuinfo"
mount --bind "$root/root/cpuinfo" "$root/proc/cpuinfo"
mkdir -p "$root/sys/devices/system/cpu"
for name in possible present online; do echo 0-1 > "$root/sys/devices/system/cpu/$name"; done
mount --rbind /dev "$root/dev"
rm -rf "$root/root/"*.whl "$root/root/environment" "$root/root/run"
cp "$wheel" constraints.txt "$root/root/"
cp /etc/resolv.conf "$root/etc/"
cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
emulated() { env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 QEMU_CPU=cortex-a76 OMP_NUM_THREADS=2 chroot "$root" "$@"; }
emulated python3 -m venv /root/environment
emulated /root/environment/bin/pip install -q --only-binary :all: -c /root/constraints.txt "/root/$(basename "$wheel")"
emulated /root/environment/bin/edgemap run --frames 30 -o /root/run | tail -n 6
emulated /root/environment/bin/pip uninstall -q -y pip setuptools
find "$root/root/environment" -type f -printf '%s\n' | awk '{s += $1} END {printf "%.0f MB installed\n", s / 1e6}'
here=$(mktemp -d)
OMP_NUM_THREADS=2 .venv/bin/edgemap run --frames 30 -o "$here" > /dev/null
.venv/bin/python - "$root/root/run" "$here" <<'END'
import sys
from pathlib import Path

import numpy as np

from edgemap.runtime.step.map_file import load_map

runs = [Path(name) for name in sys.argv[1:]]
there, here = ({item.id: item for item in load_map(run)} for run in runs)
print("objects there:", *sorted(there), "\nobjects here: ", *sorted(here))
apart_m = [np.linalg.norm(there[name].position_m - here[name].position_m) for name in set(there) & set(here)]
poses = [np.loadtxt(run / "trajectory.tum")[:, 1:3] for run in runs]
print(f"apart at most: objects {max(apart_m):.4f} m, poses {np.abs(poses[0] - poses[1]).max():.4f} m")
END
rm -r "$here"
