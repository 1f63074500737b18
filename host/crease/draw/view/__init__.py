"""`view`: tables of ticks as one page that shows the tool move. README.md in this folder says how the page is made."""

from __future__ import annotations

from crease.draw.view.page import Replay, make_page

__all__ = ["Replay", "make_page"]
