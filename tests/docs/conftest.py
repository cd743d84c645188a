import pytest

from tests.docs.pages import blocks


@pytest.fixture
def example():
    """Return a function that finds the Python block of a file that the docs show."""

    def find(file):
        (block,) = (b for b in blocks("python") if b.file == file)
        return block.text

    return find
