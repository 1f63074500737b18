"""The experiments of the paper that the method comes from, and where it breaks.

One module for each, with run(setup) -> Result.
"""
