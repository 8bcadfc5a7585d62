#!/bin/sh
# Each supported Python, with the oldest and the newest versions of the required packages: the streams of the golden run
# of the kidney, byte for byte, and then tests.
#   tests/versions.sh [pytest arguments]                  all combinations, each in a fresh environment
#   PYTHONS=3.12 tests/versions.sh tests/messages         one Python and one folder
#   PYTHONS=3.12 RESOLUTIONS=lowest-direct tests/versions.sh -      without tests
# uv makes the environments of wheels, and fetches a Python that the machine lacks. Kernels are compiled for each version of numba,
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
golden() {
    "$1/bin/python" -m palpate.cli run tests/golden/kidney.yaml --fused --clock simulated --duration 0.12 --no-pictures \
        -q --record "$1/kidney.mcap" &&
        PYTHONPATH=tests/support "$1/bin/python" -c "
import sys
from same_bytes import digests
here, golden = map(digests, sys.argv[1:])
print(sum(here[name] == golden[name] for name in golden), 'of', len(golden), 'streams have the golden bytes')
sys.exit(here != golden)" "$1/kidney.mcap" tests/golden/kidney.mcap
}
for python in $pythons; do
    for resolution in $resolutions; do
        name="$python-$resolution"
        begun=$(date +%s)
        echo "== Python $python, $resolution"
        "$uv" venv -q --python "$python" "$folder/$name" &&
            VIRTUAL_ENV="$folder/$name" "$uv" pip install -q --resolution "$resolution" --only-binary :all: -e . &&
            VIRTUAL_ENV="$folder/$name" "$uv" pip list 2>/dev/null |
                grep -E "^(numpy|scipy|numba|llvmlite|pyzmq|msgspec|typer|rich|mcap) " &&
            golden "$folder/$name" &&
            { [ "$1" = - ] || {
                VIRTUAL_ENV="$folder/$name" "$uv" pip install -q pytest pytest-timeout hypothesis msgpack mpmath &&
                    "$folder/$name/bin/python" -m pytest -q -p no:cacheprovider "$@"; }; } || failed="$failed $name"
        echo "$name: $(($(date +%s) - begun)) s"
        rm -rf "$folder/$name"
    done
done
[ -z "$failed" ] || { echo "failed:$failed" >&2; exit 1; }
