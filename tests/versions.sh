#!/bin/sh
# The fast tests on each supported Python, and with the oldest and newest versions of the required packages:
#   tests/versions.sh [pytest arguments]                  all combinations, each in a fresh environment
#   PYTHONS=3.12 tests/versions.sh tests/messages         one Python and one folder
# uv makes the environments, and fetches a Python that the machine lacks. Kernels are compiled for each version of numba,
# so a combination takes some minutes at its first run. docs/install.md has the results.
set -u
cd "$(dirname "$0")/.."
pythons=${PYTHONS:-3.11 3.12 3.13 3.14}
resolutions=${RESOLUTIONS:-lowest-direct highest}
[ $# -gt 0 ] || set -- tests/physics tests/messages
uv=$(command -v uv || echo .venv/bin/uv)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT INT TERM
failed=""
for python in $pythons; do
    for resolution in $resolutions; do
        name="$python-$resolution"
        echo "== Python $python, $resolution"
        "$uv" venv -q --python "$python" "$folder/$name" &&
            VIRTUAL_ENV="$folder/$name" "$uv" pip install -q --resolution "$resolution" -e . &&
            VIRTUAL_ENV="$folder/$name" "$uv" pip install -q pytest pytest-timeout hypothesis msgpack &&
            VIRTUAL_ENV="$folder/$name" "$uv" pip list 2>/dev/null |
                grep -E "^(numpy|scipy|numba|pyzmq|msgspec) " &&
            "$folder/$name/bin/python" -m pytest -q -p no:cacheprovider "$@" || failed="$failed $name"
    done
done
[ -z "$failed" ] || { echo "failed:$failed" >&2; exit 1; }
