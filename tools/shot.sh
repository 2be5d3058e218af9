#!/usr/bin/env bash
# Renders a picture of a recording on a machine without a screen or graphics card:
#
#     tools/shot.sh RECORDING.rrd PICTURE.png [WIDTHxHEIGHT]
#
# The viewer opens the recording at its end, with the recording's own layout; then a screenshot is taken. Takes up to a minute.
set -euo pipefail

usage() { echo "usage: tools/shot.sh RECORDING.rrd PICTURE.png [WIDTHxHEIGHT]" >&2; exit 2; }
[ $# -ge 2 ] || usage
recording=$(realpath -- "$1") picture=$(realpath -m -- "$2") size=${3:-1600x1000}
[ -f "$recording" ] || { echo "there is no recording at $1" >&2; exit 2; }
[[ $size =~ ^[0-9]+x[0-9]+$ ]] || usage

missing() { echo "$1 is missing; get it with: $2" >&2; exit 2; }
packages="apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers"
command -v rerun > /dev/null || missing "the viewer" "pip install rerun-sdk==0.36.3"
driver=$(find /usr/share/vulkan/icd.d -name 'lvp_icd*.json' 2> /dev/null | head -n 1)
[ -n "$driver" ] || missing "the software Vulkan driver" "$packages"
viewer=$(command -v rerun)
# a version manager's shim looks up the real program from the home folder, which is about to change
command -v pyenv > /dev/null && viewer=$(pyenv which rerun 2> /dev/null || echo "$viewer")
python=${PYTHON:-python3}
"$python" -c 'import rerun.experimental' 2> /dev/null || missing "the viewer's Python package" "pip install rerun-sdk==0.36.3"

# the viewer remembers layouts in the home folder, so it gets a fresh one
home=$(mktemp -d)
pid=
# the viewer is a script with the program as its child: both must end
cleanup() { [ -z "$pid" ] || kill -- "-$pid" 2> /dev/null || true; rm -rf "$home"; }
trap cleanup EXIT
rm -f "$picture"
mkdir -p "$(dirname "$picture")"
port=$((20000 + RANDOM % 20000))
HOME="$home" XDG_CONFIG_HOME="$home" XDG_DATA_HOME="$home" XDG_CACHE_HOME="$home" RUST_LOG=error \
    WGPU_BACKEND=vulkan VK_ICD_FILENAMES="$driver" \
    setsid "$viewer" --headless --window-size "$size" --port "$port" "$recording" > "$home/log" 2>&1 &
pid=$!

# the viewer loads while it draws, and without a graphics card it draws slowly: done when two pictures are the same, or
# after the eighth, since a recording that plays (that of a model) never rests
"$python" - "$port" "$home" "$picture" << 'PY' || { tail -n 20 "$home/log" >&2; exit 1; }
import os, sys, time
from rerun.experimental import ViewerClient

port, home, picture = sys.argv[1:]
end = time.monotonic() + 240
client = None
last = None
taken = 0
while time.monotonic() < end and taken < 8:
    time.sleep(3)
    try:
        client = client or ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        shot = os.path.join(home, "shot.png")
        client.save_screenshot(shot)
    except Exception as error:
        last_error = error
        continue
    for _ in range(200):
        time.sleep(0.1)
        size = os.path.getsize(shot) if os.path.exists(shot) else 0
        if size and size == (time.sleep(0.3) or os.path.getsize(shot)):
            break
    else:
        continue
    now = open(shot, "rb").read()
    os.remove(shot)
    if now == last:
        open(picture, "wb").write(now)
        sys.exit(0)
    last = now
    taken += 1
if last:
    open(picture, "wb").write(last)
    sys.exit(0)
sys.exit("no picture came out; the viewer said:")
PY
# the viewer renders at twice the size; bring it down where Pillow is installed
"$python" - "$picture" "$size" << 'PY' 2> /dev/null || true
import sys
from PIL import Image
width, height = map(int, sys.argv[2].split("x"))
image = Image.open(sys.argv[1]).convert("RGB").resize((width, height), Image.LANCZOS)
# without the top bar, which only says that this machine has no graphics card
image.crop((0, 29, width, height)).save(sys.argv[1], optimize=True)
PY
echo "$picture"
