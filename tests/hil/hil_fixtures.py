"""Tests that need a vcan0: `make hil` runs them on one, native or in User-Mode Linux. Elsewhere they are not collected.

Every run says in its header which it is.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hil_tools import bake_scene

ON_VCAN = os.environ.get("CREASE_TRANSPORT") == "socketcan"


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Nothing here without a vcan0."""
    return None if ON_VCAN or collection_path.suffix != ".py" else True


def pytest_report_header() -> str:
    """Which it is."""
    return "hardware in the loop: " + ("on vcan0" if ON_VCAN else "not here; run make hil")


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene that the firmware gets."""
    return bake_scene(tmp_path_factory.mktemp("scene"))
