#!/bin/sh
# The bytes of an emulated 64-bit ARM processor against those of this x86-64 machine: tests/arm64.sh FOLDER [GRAPH...]
# As root on Debian 12: apt install qemu-user-static debootstrap. The first call fills FOLDER (0.6 GB): Debian's packages of
# Python 3.11 for arm64, and the wheels for aarch64 of the packages that this environment has. Each graph then runs here and
# there for 0.12 s, and each recording is checked on the other machine. Emulated compilation takes minutes for a graph.
set -eu
cd "$(dirname "$0")/.."
here=$PWD
folder=$(mkdir -p "$1" && cd "$1" && pwd)
shift
[ $# -gt 0 ] || set -- tests/golden/kidney.yaml
if [ ! -e "$folder/tree/usr/bin/python3.11" ]; then
    debootstrap --foreign --arch=arm64 --variant=minbase --include=python3,libpython3-stdlib bookworm "$folder/tree"
    for package in "$folder"/tree/var/cache/apt/archives/*.deb; do dpkg-deb -x "$package" "$folder/tree"; done
fi
if [ ! -d "$folder/packages/numba" ]; then
    wanted=$(.venv/bin/pip freeze | grep -E "^(numpy|scipy|numba|llvmlite|msgspec|PyYAML|mcap|zstandard|lz4|rich|typer|pyzmq)==")
    .venv/bin/pip install -q --target "$folder/packages" --platform manylinux2014_aarch64 --platform manylinux_2_27_aarch64 \
        --platform manylinux_2_28_aarch64 --python-version 3.11 --implementation cp --only-binary=:all: $wanted
fi
there() {
    env PYTHONPATH="$here/src:$folder/packages" NUMBA_CACHE_DIR="$folder/cache" \
        qemu-aarch64-static -L "$folder/tree" "$folder/tree/usr/bin/python3.11" -m palpate.cli "$@"
}
failed=""
for graph in "$@"; do
    name=$(basename "$graph" .yaml)
    common="--fused --clock simulated --duration 0.12 --no-pictures -q --force"
    .venv/bin/python -m palpate.cli run "$graph" $common --record "$folder/$name-x86.mcap"
    begun=$(date +%s)
    there run "$graph" $common --record "$folder/$name-arm.mcap"
    echo "$name: emulated run $(($(date +%s) - begun)) s"
    there replay "$folder/$name-x86.mcap" --check --tolerance 0 || failed="$failed $name-on-ARM"
    .venv/bin/python -m palpate.cli replay "$folder/$name-arm.mcap" --check --tolerance 0 || failed="$failed $name-from-ARM"
done
[ -z "$failed" ] || { echo "other bytes:$failed" >&2; exit 1; }
