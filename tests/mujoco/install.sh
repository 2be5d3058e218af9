#!/usr/bin/env bash
# Fetches the MuJoCo library that the feature `mujoco` links, once, into $MOBEE_MUJOCO (default ~/.cache/mobee/mujoco-3.17.0): 7 MB,
# out of the wheel of the package registry. Prints how to build with it.
#
# Exit code 0: it is there, or can't be obtained, and the last line says why ("skipped: ...").
set -euo pipefail

version=3.17.0
sha256=23496b023ee80fb61ab71167e94bc649f9941710fde96b18bb8204fb332523ad
home=${MOBEE_MUJOCO:-$HOME/.cache/mobee/mujoco-$version}

skip() { echo "skipped: $*; the tests with MuJoCo's physics will be skipped too"; exit 0; }

mkdir -p "$home"
exec 9>"$home/.lock"
flock 9  # two runs at the same time: the second one finds the work done
if [ ! -e "$home/lib/libmujoco.so" ]; then
    [ "$(uname -s)-$(uname -m)" = Linux-x86_64 ] || skip "this script knows the library of x86-64 Linux only"
    python=$(command -v python3) || skip "there is no python3"
    rm -rf "$home/wheel" && mkdir -p "$home/wheel" "$home/lib"
    "$python" -m pip download --quiet --no-deps --only-binary=:all: --python-version 3.12 --dest "$home/wheel" "mujoco==$version" \
        > "$home/install.log" 2>&1 || skip "the package registry gives no mujoco $version (see $home/install.log)"
    "$python" - "$home" "$version" <<'PYTHON'
import pathlib, sys, zipfile
home, version = pathlib.Path(sys.argv[1]), sys.argv[2]
name = f"libmujoco.so.{version}"
with zipfile.ZipFile(next((home / "wheel").glob("*.whl"))) as wheel:
    (home / "lib" / name).write_bytes(wheel.read(f"mujoco/{name}"))
(home / "lib/libmujoco.so").symlink_to(name)
PYTHON
    rm -rf "$home/wheel"
    if ! echo "$sha256  $home/lib/libmujoco.so" | sha256sum --check --status; then
        rm -f "$home/lib/libmujoco.so"
        echo "failed: the library has another checksum than $sha256" >&2
        exit 1
    fi
fi
echo "MuJoCo $version is in $home; to build with it: MUJOCO_DYNAMIC_LINK_DIR=$home/lib cargo build --release --features mujoco"
