import pytest

from palpate.launch.run.tasks.local import local


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    """Two worker processes for all tests that leave them alive."""
    with local(2, tmp_path_factory.mktemp("local") / "workers.log") as workers:
        yield workers
