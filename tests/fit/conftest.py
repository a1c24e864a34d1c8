import pathlib
import sys

import pytest

# The helpers of these tests stand beside them.
sys.path.insert(0, str(pathlib.Path(__file__).parent))


@pytest.fixture
def small_room(monkeypatch):
    """Search no farther for hair than there is something around a ball."""
    monkeypatch.setattr("hairfit.fit.hull.REACH", 0.2)
