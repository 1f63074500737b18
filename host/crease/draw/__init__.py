"""Plots, the demo, and the page that shows a tool move."""

import logging

_OF_ITS_CACHE = ("mkdir -p failed for path", "Matplotlib created a temporary cache directory")
logging.getLogger("matplotlib").addFilter(
    # Where the home cannot be written it makes a folder for the time of its run; nobody has to act.
    lambda record: not str(record.msg).startswith(_OF_ITS_CACHE)
)
