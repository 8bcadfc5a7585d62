"""Runs a list of commands of palpate, each a list of words, from standard input as JSON; answers with the exit code and
the text of each. One process for all, as each starts for a second."""

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
