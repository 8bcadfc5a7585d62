#!/bin/sh
# The tests under instructions other than those that palpate pins: tests/portability.sh [pytest arguments]
# No test may need the last bits of one processor. An hour for the whole suite; golden recordings are compared within
# their tolerance. Settings of a newer processor than this one are passed over by the libraries.
# `tests/arm64.sh` compares bytes with an emulated 64-bit ARM processor; `tests/versions.sh` runs other Pythons and libraries.
set -u
cd "$(dirname "$0")/.."
failed=""
try() {
    core=$1 disabled=$2 kernels=$3
    shift 3
    echo "OpenBLAS $core, numpy without '$disabled', kernels for ${kernels:-this processor}"
    if [ -n "$kernels" ]; then
        export NUMBA_CPU_NAME="$kernels" NUMBA_CPU_FEATURES=""
    else
        unset NUMBA_CPU_NAME NUMBA_CPU_FEATURES
    fi
    PALPATE_NATIVE=1 OPENBLAS_CORETYPE=$core NPY_DISABLE_CPU_FEATURES=$disabled \
        .venv/bin/python -m pytest "$@" || failed="$failed $core"
}
try SkylakeX "" "" "$@"
try Zen "X86_V4 AVX512_ICL AVX512_SPR" x86-64-v3 "$@"
try Sandybridge "X86_V3 X86_V4 AVX512_ICL AVX512_SPR" x86-64-v3 "$@"
try Prescott "X86_V3 X86_V4 AVX512_ICL AVX512_SPR" x86-64-v2 "$@"
[ -z "$failed" ] || { echo "failed with OpenBLAS kernels for:$failed" >&2; exit 1; }
