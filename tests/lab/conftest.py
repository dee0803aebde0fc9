import pytest

from tests.lab.recorded import Laboratory


@pytest.fixture
def laboratory(tmp_path):
    made = Laboratory(tmp_path)
    made.write()
    return made
