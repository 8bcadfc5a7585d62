"""The searches of these tests touch the same surfaces, whose refinement takes up to seven seconds each."""

from functools import lru_cache

import pytest

from palpate.nodes.base import surface


@pytest.fixture(scope="session", autouse=True)
def refined_once():
    """Keep the refined meshes of all files, not of the last two."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(surface, "_file_mesh", lru_cache(maxsize=100)(surface._file_mesh.__wrapped__))
        yield
