"""The motor bus seen from the host: one dictionary, what is generated from it, and python-can.

`dictionary` reads dictionary.toml; `eds`, `dbc`, `header`, `tables` turn it into files; `schedule` computes response times;
`transport` opens a bus; `inprocess` is a bus with the simulated drives behind it; `monitor` decodes frames into a table.
"""
