"""Faults really done to a running product: how soon they are noticed, what is lost, how it recovers.

Each test does one fault and gives `record` a `Row`: the limits are asserted there, and the rows are what
`python -m tests.faults` makes docs/results/faults.md from.
"""
