#!/bin/sh
# Set palpate up in .venv: ./setup.sh for running, looking and recording; ./setup.sh dev adds all extras and what ./check.sh needs.
# Needs Python 3.11 or newer. Debian packages are installed where this user may; else they are named.
set -eu
cd "$(dirname "$0")"
unset PYTHONDONTWRITEBYTECODE # containers set it; then each later command would parse a thousand sources again
tests=no
case "${1:-}" in
    "") set -- "palpate[view,page,devices]" "vtk<9.6; python_version < '3.14'" ;; # later wheels of VTK are 120 MB larger
    dev)
        tests=yes
        set -- "palpate[all,dev]"
        ;;
    *)
        echo "setup: found '$1', expected nothing or 'dev'" >&2
        exit 2
        ;;
esac

python=""
for found in "${PYTHON:-}" python3 python3.14 python3.13 python3.12 python3.11; do
    if [ -n "$found" ] && "$found" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        python=$found
        break
    fi
done
if [ -z "$python" ]; then
    echo "setup: no Python 3.11 or newer found. Install one, or name it: PYTHON=/path/to/python3.11 ./setup.sh" >&2
    exit 1
fi

# Off-screen 3-D pictures need OSMesa, devices on USB libusb; python3-venv is a package of its own on Debian.
# apt-get works while pip does.
packages="" debian=""
ldconfig -p 2>/dev/null | grep -q 'libOSMesa\.so' || packages="libosmesa6"
ldconfig -p 2>/dev/null | grep -q 'libusb-1\.0\.so' || packages="$packages libusb-1.0-0"
"$python" -c 'import ensurepip' 2>/dev/null || packages="$packages python3-venv"
if [ -n "$packages" ] && command -v apt-get >/dev/null 2>&1; then
    if [ "$(id -u)" = 0 ]; then
        root=""
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then
        root="sudo"
    else
        root="no"
    fi
    if [ "$root" = "no" ]; then
        echo "setup: not allowed to install Debian packages; for all pictures and devices: sudo apt-get install $packages" >&2
    else
        # shellcheck disable=SC2086
        { { $root apt-get update -qq && $root apt-get install -y -qq $packages; } >/dev/null 2>&1 </dev/null ||
            echo "setup: apt-get could not install: $packages (3-D pictures or USB devices may be missing)" >&2; } &
        debian=$!
        case $packages in *python3-venv*) wait $debian ;; esac
    fi
fi

[ -x .venv/bin/python ] || "$python" -m venv .venv
install() {
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile "$@"
}
# Python's releases bring a pip that is up to three years old; that of 3.11.7 takes twice as long to choose and install
# these packages (92 s against 47). With no newer one at hand it serves as well.
install --retries 0 --upgrade pip 2>/dev/null || true
# The kernels of the usual graphs are compiled, on two cores, while pip installs the packages for pictures. The tests
# need nearly all kernels: of the others as many are compiled as pip takes for their packages.
install -e .
(
    [ "$tests" = yes ] || exec .venv/bin/python -m palpate.cli.machine.kernels
    .venv/bin/python -m palpate.cli.machine.kernels
    exec .venv/bin/python -m palpate.cli.machine.kernels all >/dev/null 2>&1
) &
kernels=$!
trap 'kill $kernels 2>/dev/null || true' EXIT
install "$@"
[ -z "$debian" ] || wait "$debian"
.venv/bin/python -m palpate.cli.machine.bytecode tests/golden/kidney.mcap >/dev/null ||
    echo "setup: the bytecode was not written; commands start more slowly" >&2
{ [ "$tests" = yes ] && kill $kernels 2>/dev/null; } || wait $kernels ||
    echo "setup: the kernels were not compiled; the first run compiles them" >&2
trap - EXIT
echo "palpate is ready: .venv/bin/palpate"
