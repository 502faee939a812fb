"""Trackers of everything that moves before a still camera (papers 2 and 3).

`imm_pf` is the IMM particle filter without transition priors, `jpda` joint probabilistic data association,
`background` the statistical background model; `foreground` is the protocol of what finds moving pixels,
`appearance` compares objects by their histograms, `tracked` is what both trackers give.
"""
