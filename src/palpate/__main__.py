"""`python -m palpate` is the command `palpate`, where the shell does not find that."""

import runpy

runpy.run_module("palpate.cli", run_name="__main__")
