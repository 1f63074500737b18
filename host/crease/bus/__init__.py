"""The motor bus seen from the host: one dictionary, what is generated from it, and python-can.

`dictionary` reads dictionary.toml; `eds`, `dbc`, `header` and `generate` turn it into files; `schedule` computes
response times; `drives` are the simulated ones; `transport` opens a bus; `inprocess` is one with the drives behind it;
`monitor` decodes frames into a table.
"""
