#!/bin/sh
# The bytes of an emulated 64-bit ARM processor against those of this x86-64 machine: tests/arm64.sh FOLDER [RUN...]
#   tests/arm64.sh FOLDER                                       all bodies and shipped graphs, 17 runs
#   tests/arm64.sh FOLDER "kidney --set tissue.use=deformation.ReducedFE" texture
#   WHEEL=yes tests/arm64.sh FOLDER [RUN...]                    from the wheel for aarch64, whose kernels are made here
# As root on Debian 12: apt install qemu-user-static debootstrap. The first call fills FOLDER (0.6 GB): Debian's packages of
# Python 3.11 for arm64, and the wheels for aarch64 of the packages that this environment has. Each RUN, the arguments of
# `palpate run`, is computed here and there; the streams are compared, and each recording is checked on the other machine.
# Emulated compilation takes minutes for a graph, and its result stays in FOLDER. With WHEEL it fails if a kernel is
# compiled there, without RUN also by any other graph, body or node. docs/install.md has the results.
set -eu
cd "$(dirname "$0")/.."
here=$PWD
folder=$(mkdir -p "$1" && cd "$1" && pwd)
shift
body="kidney --set tissue.use=deformation"
all=""
[ $# -gt 0 ] || all=yes
[ -z "$all" ] || set -- tests/golden/kidney.yaml tests/golden/plane.yaml "kidney --place apart" \
    "$body.BeamBundle" "$body.ReducedFE" "$body.ReducedFE --place apart" "$body.Rigid" "nodule --scene afferents" \
    texture "texture --scene grating" pinch "fingertip-slide --duration 1.6" fingertip softness palpate-two organs remote
if [ ! -e "$folder/tree/usr/bin/python3.11" ]; then
    debootstrap --foreign --arch=arm64 --variant=minbase --include=python3,libpython3-stdlib bookworm "$folder/tree"
    for package in "$folder"/tree/var/cache/apt/archives/*.deb; do dpkg-deb -x "$package" "$folder/tree"; done
fi
if [ ! -d "$folder/packages/numba" ]; then
    wanted=$(.venv/bin/pip freeze | grep -E "^(numpy|scipy|numba|llvmlite|msgspec|PyYAML|mcap|zstandard|lz4|rich|typer|pyzmq|scikit-image|manifold3d)==")
    .venv/bin/pip install -q --target "$folder/packages" --platform manylinux2014_aarch64 --platform manylinux_2_27_aarch64 \
        --platform manylinux_2_28_aarch64 --python-version 3.11 --implementation cp --only-binary=:all: $wanted
fi
# An emulated process starts others through this script.
cat >"$folder/python" <<END
#!/bin/sh
exec qemu-aarch64-static -L "$folder/tree" "$folder/tree/usr/bin/python3.11" "\$@"
END
chmod +x "$folder/python"
mkdir -p "$folder/site"
echo "import sys; sys.executable = '$folder/python'" >"$folder/site/sitecustomize.py"
palpate=$here/src cache=$folder/cache
if [ -n "${WHEEL:-}" ]; then
    palpate=$folder/content cache=$folder/empty
    rm -rf "$folder/wheel" "$palpate" "$cache"
    .venv/bin/python -m build --wheel -C kernels=aarch64 --outdir "$folder/wheel" >"$folder/build" 2>&1 || { cat "$folder/build"; exit 1; }
    .venv/bin/python -m zipfile -e "$folder"/wheel/palpate-*_aarch64.whl "$palpate"
fi
emulated() {
    env PYTHONPATH="$folder/site:$palpate:$folder/packages" NUMBA_CACHE_DIR="$cache" XDG_CACHE_HOME="$cache" \
        "$folder/python" -m "$@"
}
there() { emulated palpate.cli "$@"; }
# Whether the check of a recording finds all messages bit-equal; streams that were left out of it are not compared.
bit_equal() {
    "$@" --check --tolerance 0 >"$folder/check" 2>&1 || true
    cat "$folder/check"
    grep -q "computed again: bit-equal" "$folder/check"
}
failed=""
if [ -n "${WHEEL:-}" ] && [ -n "$all" ]; then
    rm -rf "$folder/loaded"
    emulated palpate.cli.machine.kernels copy "$folder/loaded" || failed="
all graphs, bodies and nodes: not all kernels are in the wheel"
    echo "$(find "$folder/loaded" -name "*.nbc" | wc -l) of $(find "$palpate" -name "*.nbc" | wc -l) kernels of the wheel are loaded"
fi
: >"$folder/equal"
for run in "$@"; do
    name=$(echo "$run" | tr -c 'A-Za-z0-9.\n' _)
    x86=$folder/$name-x86.mcap arm=$folder/$name-arm.mcap
    case $run in *--place*) way="" ;; *) way=--fused ;; esac
    common="--duration 0.6 $run $way --clock simulated --no-pictures -q --force"
    echo "== $run"
    .venv/bin/python -m palpate.cli run $common --record "$x86"
    begun=$(date +%s)
    there run $common --record "$arm" || { failed="$failed
$run: no run on ARM"; continue; }
    ran=$(date +%s)
    PYTHONPATH=tests/support .venv/bin/python -c "
import sys
from same_bytes import digests
x86, arm = map(digests, sys.argv[1:3])
other = sorted(name for name in x86 | arm if x86.get(name) != arm.get(name))
print(len(x86) - len(other), len(x86), file=open(sys.argv[3], 'a'))
print(len(x86) - len(other), 'streams equal;', 'other bytes:', ', '.join(other) or 'none')
sys.exit(bool(other))" "$x86" "$arm" "$folder/equal" || failed="$failed
$run: other bytes"
    bit_equal there replay "$x86" || failed="$failed
$run: replayed on ARM"
    bit_equal .venv/bin/python -m palpate.cli replay "$arm" || failed="$failed
$run: replayed from ARM"
    compiled=$(find "$cache" -name "*.nbc" | wc -l)
    [ -z "${WHEEL:-}" ] || [ "$compiled" = 0 ] || failed="$failed
$run: $compiled kernels compiled on ARM"
    echo "$run: emulated run $((ran - begun)) s, check $(($(date +%s) - ran)) s, $compiled kernels compiled there so far"
done
awk '{ equal += $1; all += $2; runs += $1 == $2 }
    END { print equal, "of", all, "streams have the same bytes on both processors; all streams in", runs, "of", NR, "runs" }' "$folder/equal"
[ -z "$failed" ] || { echo "failed:$failed" >&2; exit 1; }
