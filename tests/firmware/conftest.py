import pytest

from tests.firmware.library import Library, built


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Protocol and core, compiled with warnings as errors."""
    return built(tmp_path_factory.mktemp("firmware"))
