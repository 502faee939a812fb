"""Whatever strangers, disks and lines may send, at random: a few in the suite, many by hand.

`python -m tests.attacks --count 10000 --seed 7` writes what became of them.
"""
