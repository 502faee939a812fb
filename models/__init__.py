"""Joint detection and tracking: pure numerics, arrays in and arrays out.

Nothing here starts a thread, reads a clock, opens a file or keeps global state, and nothing
here imports `service`. Random generators are arguments.
"""
