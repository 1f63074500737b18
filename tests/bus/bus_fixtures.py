"""The transport as a fixture: every protocol test runs on each of them.

`inprocess` and `virtual` need no privileges. On a machine (or in a kernel, see tests/hil/lab) with vcan0,
CREASE_TRANSPORT=socketcan runs the same tests on it instead, with the drives in a process of their own.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from bus_tools import Link, make_link

TRANSPORTS = os.environ.get("CREASE_TRANSPORT", "inprocess,virtual").split(",")


def pytest_report_header() -> str:
    """`make test` says which transport ran."""
    return f"bus transports: {', '.join(TRANSPORTS)}"


@pytest.fixture(params=TRANSPORTS)
def link(request: pytest.FixtureRequest) -> Iterator[Link]:
    """A bus with the simulated drives on it, and the host's end of it."""
    with make_link(request.param) as made:
        yield made


@pytest.fixture(scope="session")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the EDS of every drive and the DBC."""
    from crease.bus.generate import export

    folder = tmp_path_factory.mktemp("generated")
    export(folder)
    return folder
