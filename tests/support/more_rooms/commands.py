"""Runs a list of palpate commands, each a list of words, from JSON on standard input; prints the exit code and the
output of each. They share a process, because a start takes 1 s."""

import contextlib
import io
import json
import sys

from palpate.cli.__main__ import app

answers = []
for words in json.load(sys.stdin):
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            code = app(words, standalone_mode=False) or 0
        except SystemExit as error:
            code = error.code
    answers.append((code, printed.getvalue()))
print(json.dumps(answers))
