#!/usr/bin/env bash
# Installs the robots that URDF import is tested with, once, under $MOBEE_ROBOTS (default ~/.cache/mobee/robots-1): the URDF files
# and meshes of the PyPI packages example-robot-data and icub-models, 470 MB, as their wheels contain them.
#
# Exit code 0: they are installed, or can't be obtained, and the last line says why ("skipped: ...").
# Any other: the download was damaged.
set -euo pipefail

home=${MOBEE_ROBOTS:-$HOME/.cache/mobee/robots-1}
log=$home/install.log
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

skip() { echo "skipped: $*; the tests with other people's robots will be skipped too"; exit 0; }
fail() { echo "failed: $*" >&2; exit 1; }

mkdir -p "$home"
exec 9>"$home/.lock"
flock 9  # two runs at the same time: the second one finds the work done
if [ ! -f "$home/.installed" ]; then
    python=$(command -v python3) || skip "there is no python3"
    "$python" -m pip --version > "$log" 2>&1 || skip "there is no pip"
    rm -rf "$home/share" "$home/packages"
    if ! "$python" -m pip install --quiet --no-deps --only-binary :all: --require-hashes --target "$home/packages" \
        --requirement "$here/requirements.txt" >> "$log" 2>&1; then
        ! grep -q "DO NOT MATCH THE HASHES" "$log" || fail "a downloaded package has another checksum (see $log)"
        skip "the package registry gives no example-robot-data or icub-models (see $log)"
    fi
    # one folder per package of robots, as ROS would have them
    mkdir "$home/share"
    mv "$home/packages/cmeel.prefix/share/example-robot-data" "$home/packages/share/iCub" "$home/share/"
    rm -rf "$home/packages"
    touch "$home/.installed"
fi
echo "other people's robots are in $home"
