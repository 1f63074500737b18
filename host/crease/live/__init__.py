"""The closed loop while it runs: a page on this machine shows it, and a mouse leads the tool. README.md says how."""
