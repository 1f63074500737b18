"""Fixtures of the bus tests."""

from bus_fixtures import generated, link, pytest_report_header

__all__ = ["generated", "link", "pytest_report_header"]
