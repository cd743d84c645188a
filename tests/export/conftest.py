import pytest

from tests.remembered import remembered_proofs


@pytest.fixture(scope="module", autouse=True)
def _cheaper():
    with remembered_proofs():
        yield
