"""A path, or a recording, through the firmware's tick; and what its answers are measured by."""
