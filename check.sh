#!/bin/sh
# Lint, spelling, types and tests, in the environment that ./setup.sh dev made: ./check.sh [--fast | docs | pytest arguments]
# --fast, after each edit: formulas, messages, nodes, and how graphs are loaded.
# docs: builds the documentation site in docs/_build; a warning is an error.
set -eu
cd "$(dirname "$0")"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
unset PYTHONDONTWRITEBYTECODE # if set, each of about a hundred processes would compile all sources
if ! { [ -x .venv/bin/ruff ] && [ -x .venv/bin/mypy ] && [ -x .venv/bin/codespell ] &&
    .venv/bin/python -c "import pytest, xdist, sphinx" 2>/dev/null; }; then
    echo "check: the packages for tests are missing in .venv; run ./setup.sh dev first" >&2
    exit 2
fi
if [ "${1:-}" = "docs" ]; then
    .venv/bin/python -m sphinx --fail-on-warning --keep-going -q -b html docs docs/_build
    echo "docs/_build/index.html"
    exit
fi
if [ "${1:-}" = "--fast" ]; then
    shift
    set -- tests/physics tests/messages tests/nodes tests/launch/load tests/test_imports.py "$@"
fi
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/codespell .
types=$(mktemp)
.venv/bin/mypy >"$types" 2>&1 &
mypy=$!
failed=0
# Compile the kernels that most tests need once, in parallel with mypy, instead of in each test process.
.venv/bin/palpate run kidney --fused --duration 0.01 --no-record --no-pictures >/dev/null 2>&1 || true
.venv/bin/python -m pytest -n 3 --dist worksteal "$@" || failed=$?
wait "$mypy" || failed=1
cat "$types"
rm -f "$types"
exit "$failed"
