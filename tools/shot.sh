#!/usr/bin/env bash
# A picture of a recording, on a machine without screen or graphics card:
#
#     tools/shot.sh RECORDING.rrd PICTURE.png [WIDTHxHEIGHT]
#
# The viewer opens the recording with the layout it carries, at its end, and is photographed. Takes about a minute.
set -euo pipefail

usage() { echo "usage: tools/shot.sh RECORDING.rrd PICTURE.png [WIDTHxHEIGHT]" >&2; exit 2; }
[ $# -ge 2 ] || usage
recording=$(realpath -- "$1") picture=$(realpath -m -- "$2") size=${3:-1600x1000}
[ -f "$recording" ] || { echo "there is no recording at $1" >&2; exit 2; }
[[ $size =~ ^[0-9]+x[0-9]+$ ]] || usage

missing() { echo "$1 is missing; get it with: $2" >&2; exit 2; }
packages="apt-get install -y --no-install-recommends xvfb xauth libvulkan1 mesa-vulkan-drivers libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2"
command -v rerun > /dev/null || missing "the viewer" "pip install rerun-sdk==0.36.3"
command -v xvfb-run > /dev/null || missing "the screenless X server" "$packages"
driver=$(find /usr/share/vulkan/icd.d -name 'lvp_icd*.json' 2> /dev/null | head -n 1)
[ -n "$driver" ] || missing "the software Vulkan driver" "$packages"
viewer=$(command -v rerun)
# a version manager's stand-in looks its real program up from the home folder, which is about to be another one
command -v pyenv > /dev/null && viewer=$(pyenv which rerun 2> /dev/null || echo "$viewer")

# the viewer remembers layouts in the home folder, so it gets a fresh one
home=$(mktemp -d)
trap 'rm -rf "$home"' EXIT
rm -f "$picture"
mkdir -p "$(dirname "$picture")"
# it leaves with 102 after saving, so the file counts, not the exit status
HOME="$home" XDG_CONFIG_HOME="$home" XDG_DATA_HOME="$home" XDG_CACHE_HOME="$home" RUST_LOG=error \
    WGPU_BACKEND=vulkan VK_ICD_FILENAMES="$driver" \
    timeout 240 xvfb-run -a -s "-screen 0 ${size}x24" \
    "$viewer" --window-size "$size" --screenshot-to "$picture" --port auto "$recording" > "$home/log" 2>&1 || true
if [ ! -s "$picture" ]; then
    echo "no picture came out; the viewer said:" >&2
    tail -n 20 "$home/log" >&2
    exit 1
fi
# the viewer renders at twice the size; bring it down where Pillow is installed
python3 - "$picture" "$size" << 'PY' 2> /dev/null || true
import sys
from PIL import Image
width, height = map(int, sys.argv[2].split("x"))
image = Image.open(sys.argv[1]).convert("RGB")
image.resize((width, height), Image.LANCZOS).save(sys.argv[1], optimize=True)
PY
echo "$picture"
