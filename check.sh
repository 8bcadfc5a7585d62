#!/bin/sh
# Lint, types and tests, in the environment that setup.sh made: ./check.sh [--fast | pytest arguments]
# --fast, after each edit: formulas, messages, nodes, and how graphs are loaded.
set -eu
cd "$(dirname "$0")"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
unset PYTHONDONTWRITEBYTECODE # where it is set, each of some hundred processes would compile all sources anew
if [ "${1:-}" = "--fast" ]; then
    shift
    set -- tests/physics tests/messages tests/nodes tests/launch/load tests/test_imports.py "$@"
fi
.venv/bin/ruff check .
.venv/bin/ruff format --check .
types=$(mktemp)
.venv/bin/mypy >"$types" 2>&1 &
mypy=$!
failed=0
.venv/bin/python -m pytest -n 3 --dist worksteal "$@" || failed=$?
wait "$mypy" || failed=1
cat "$types"
rm -f "$types"
exit "$failed"
