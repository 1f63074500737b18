"""The one tree of errors that a user can cause or mend."""

from __future__ import annotations


class CreaseError(Exception):
    """Something outside the program is wrong. The text is one line: what, where, and the mend."""


class UsageError(CreaseError):
    """What the command line asks for does not go together, whatever the files hold."""


class MeshError(CreaseError):
    """A mesh file cannot be read, or its surface cannot be mended."""


class TrajectoryError(CreaseError):
    """A path file has a bad header or a bad row."""


class TableError(CreaseError):
    """A table of ticks cannot be read or written."""


class SceneError(CreaseError):
    """A scene image cannot be opened, or its world cannot be made."""


class UnitError(CreaseError):
    """A text is not a length, or not a unit of length."""


class BusError(CreaseError):
    """The bus cannot be opened, a frame on it is not ours, or the dictionary is wrong."""


class RecordingError(CreaseError):
    """A recording of the servo cannot be read, or cannot be run again."""


class LoopError(CreaseError):
    """The closed loop cannot be made or does not come up."""
