"""The version, as the C header has it: firmware/crease.h is the one place where it stands."""

from __future__ import annotations

from crease.base.native import lib

VERSION = f"{lib.CR_VERSION_MAJOR}.{lib.CR_VERSION_MINOR}.{lib.CR_VERSION_PATCH}"
"""Semantic version of library, package and command. What a change of it promises: firmware/CHANGELOG.md."""
