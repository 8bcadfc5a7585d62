#!/bin/sh
# Lint, spelling, types and tests, in the environment that ./setup.sh dev made: ./check.sh [--fast | --all | docs | pytest arguments]
# --all: also the slow tests (tests/slow.txt), which runs of the whole suite or of folders leave out, and numpy's types.
# --fast, after each edit: the tests of the files that differ from the last commit (tests/changed.py).
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
    # shellcheck disable=SC2046 # one word for each file
    set -- --quick $(.venv/bin/python tests/changed.py) "$@"
fi
types=$(mktemp)
case " $* " in
    *" --all "*) .venv/bin/mypy >"$types" 2>&1 & ;;
    *) MYPYPATH=tests/types .venv/bin/mypy --cache-dir .mypy_cache/light >"$types" 2>&1 & ;; # see tests/types
esac
mypy=$!
trap 'kill $mypy 2>/dev/null || true; rm -f "$types"' EXIT
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/codespell .
failed=0
# Compile the kernels that most tests need once, in parallel with mypy, instead of in each test process. In a fresh copy
# also compile the tests and the rest of the sources, by collecting, which takes 38 s of processor time.
.venv/bin/palpate run kidney --fused --duration 0.01 --no-record --no-pictures >/dev/null 2>&1 || true
[ -n "$(find tests -name 'test_*-pytest-*.pyc' -print -quit)" ] ||
    .venv/bin/python -m pytest --collect-only -q "$@" >/dev/null 2>&1 || true
again=.pytest_cache/v/cache/lastfailed
case "$*" in "" | --all) whole=1 ;; *) whole=0 ;; esac
[ "$whole" = 0 ] || rm -f "$again"
.venv/bin/python -m pytest -n 3 --dist worksteal "$@" || failed=$?
types_failed=0
wait "$mypy" || types_failed=1
# A test on the real clock can fail where another program takes the processors for seconds. Of all tests, up to five that
# failed run once more, one after another; a defect fails again.
if [ "$failed" = 1 ] && [ "$whole" = 1 ] && [ "$(grep -c '::' "$again")" -le 5 ] && grep -q '::' "$again"; then
    echo "check: the tests that failed, once more, one after another"
    failed=0
    .venv/bin/python -m pytest "$@" --last-failed --last-failed-no-failures none || failed=$?
fi
cat "$types"
exit "$((failed + types_failed))"
