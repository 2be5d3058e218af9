#!/usr/bin/env bash
# Builds the real YARP 3.5.0 that our YARP is tested against, once, under $MOBEE_YARP (default
# ~/.cache/mobee/yarp-3.5.0): build/bin/{yarp,yarpserver,yarpdev}, build/share/yarp, and our C++ test programs in
# programs/. About 3 minutes on two idle cores, because nothing is optimized: the tests check what YARP says, not how fast.
# To compare speeds (yarp/examples/wire.rs), build a second one:
#
#   MOBEE_YARP=~/.cache/mobee/yarp-fast MOBEE_YARP_FLAGS="-O3 -DNDEBUG" tests/yarp/install.sh
#
# Exit code 0: YARP is installed, or can't be obtained, and the last line says why ("skipped: ...").
# Any other: the download was damaged or the build failed; the message names the log.
set -euo pipefail

version=3.5.0
sha256=7a8f78e1b6d3477fcd5e73fd5839ebf6971c3c0f5d3208d3ec0ee2b0c44507b9
packages="libsqlite3-dev libedit-dev cmake ninja-build g++"
targets="yarpserver yarp yarpdev yarp_remote_controlboard"
flags=${MOBEE_YARP_FLAGS:--O0 -DNDEBUG}
home=${MOBEE_YARP:-$HOME/.cache/mobee/yarp-$version}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

skip() { echo "skipped: $*; the tests against the real YARP will be skipped too"; exit 0; }
fail() { echo "failed: $*" >&2; exit 1; }

mkdir -p "$home/programs"
exec 9>"$home/.lock"
flock 9  # two runs at the same time: the second one finds the work done
log=$home/install.log

# The C++ programs beside this script, on the built library; cheap, and done anew when one of them changes.
programs() {
    local stamp
    stamp=$(cat "$here/CMakeLists.txt" "$here"/*.cpp | sha256sum | cut -d' ' -f1)
    if [ "$(cat "$home/programs/.stamp" 2>/dev/null)" != "$stamp" ]; then
        rm -rf "$home/programs/build" && cmake -S "$here" -B "$home/programs/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DYARP_DIR="$home/build" \
            -DCMAKE_PREFIX_PATH="$home/ycm/ycm_cmake_modules" -DCMAKE_RUNTIME_OUTPUT_DIRECTORY="$home/programs" \
            >> "$log" 2>&1 || fail "CMake refuses the test programs (see $log)"
        cmake --build "$home/programs/build" >> "$log" 2>&1 || fail "the test programs do not build (see $log)"
        echo "$stamp" > "$home/programs/.stamp"
    fi
    echo "the real YARP is in $home"
    exit 0
}

whole() { [ -f "$home/.built" ] && [ -x "$home/build/bin/yarpserver" ] && [ -x "$home/build/bin/yarpdev" ]; }
whole && programs
: > "$log"

# What the system needs
missing=""
for package in $packages; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=" $package"
done
if [ -n "$missing" ]; then
    command -v apt-get > /dev/null || skip "these packages are missing, and there is no apt-get:$missing"
    sudo=""
    [ "$(id -u)" = 0 ] || sudo="sudo -n"
    $sudo apt-get update >> "$log" 2>&1 || skip "apt-get update failed (see $log)"
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y --no-install-recommends $missing >> "$log" 2>&1 ||
        skip "apt-get can't install$missing (see $log)"
fi
python=$(command -v python3) || skip "there is no python3"

# The source distribution, by pip, which checks its hash. pip then asks the package to prepare itself, which fails without
# its build tools (with them it would build CMake first); the unpacked source stays because of --no-clean.
source=$home/source
if [ ! -f "$source/CMakeLists.txt" ]; then
    rm -rf "$home/pip" "$source" && mkdir -p "$home/pip"
    echo "yarp-middleware==$version --hash=sha256:$sha256" > "$home/pip/requirements.txt"
    TMPDIR=$home/pip "$python" -m pip download --no-clean --no-deps --no-build-isolation --require-hashes \
        --no-binary yarp-middleware --dest "$home/pip" --requirement "$home/pip/requirements.txt" >> "$log" 2>&1 || true
    ! grep -q "DO NOT MATCH THE HASHES" "$log" || fail "the downloaded source has another checksum than $sha256 (see $log)"
    found=$(find "$home/pip" -maxdepth 3 -name CMakeLists.txt -path '*/yarp-middleware_*/*' | head -n 1)
    [ -n "$found" ] || skip "the package registry gives no source of yarp-middleware $version (see $log)"
    mv "$(dirname "$found")" "$source"
    rm -rf "$home/pip"
fi

# YCM, which YARP's build needs
"$python" -m pip install --quiet --target "$home/ycm" ycm-cmake-modules >> "$log" 2>&1 ||
    skip "the package registry has no ycm-cmake-modules (see $log)"

# The build: the commands, the plug-in that the test programs use, and nothing else. The code that YARP generates for
# its messages is in the distribution; its generators need not be built first.
build=$home/build
sed -i 's/NOT ALLOW_IDL_GENERATION AND/FALSE AND/' "$source/cmake/YarpChooseIDL.cmake"
grep -qsxF "CMAKE_HOME_DIRECTORY:INTERNAL=$source" "$build/CMakeCache.txt" || rm -rf "$build"
cmake -S "$source" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_POLICY_VERSION_MINIMUM=3.5 \
    -DBUILD_SHARED_LIBS=ON -DSKIP_ACE=ON -DCMAKE_PREFIX_PATH="$home/ycm/ycm_cmake_modules" \
    -DYARP_COMPILE_GUIS=OFF -DYARP_COMPILE_TESTS=OFF -DYARP_COMPILE_BINDINGS=OFF -DYARP_COMPILE_libYARP_math=OFF \
    -DCMAKE_CXX_FLAGS="-include utility -include iterator -include cstdint" -DCMAKE_CXX_FLAGS_RELEASE="$flags" \
    >> "$log" 2>&1 ||
    fail "YARP's CMake does (see $log)"
# shellcheck disable=SC2086
cmake --build "$build" --target $targets >> "$log" 2>&1 || fail "YARP does not build (see $log)"

"$build/bin/yarp" version >> "$log" 2>&1 || fail "the built yarp does not run (see $log)"
touch "$home/.built"
programs
