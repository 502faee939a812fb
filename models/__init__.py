"""Finding and following objects in pictures with adaptive motion models: pure numerics, arrays in and arrays out.

`jdt`         joint detection and tracking by a particle filter (paper 1), for one object and for several
`likelihood`  from a picture to the log likelihood ratio of a state
`trackers`    everything that moves before a still camera: IMM particle filter, JPDA, backgrounds (papers 2, 3)
`learning`    motion models, transitions, sizes and likelihoods from labelled footage
`picture`     whether a picture is fit to judge
`evaluation`  VACE, CLEAR MOT and identity scores
`state`, `roi`, `plane`  what a particle is, from frame to working picture, from pixels to millimetres

Each package names what it offers in its own door. Nothing here starts a thread, reads a clock, opens a file,
keeps global state or imports `service`; random generators are arguments.
"""
