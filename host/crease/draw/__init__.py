"""Plots, the demo, and the page that shows a tool move."""
