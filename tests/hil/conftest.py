"""Fixtures of the tests on a real vcan."""

from hil_fixtures import pytest_ignore_collect, pytest_report_header, scene

__all__ = ["pytest_ignore_collect", "pytest_report_header", "scene"]
