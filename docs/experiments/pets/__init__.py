"""PETS 2009 S2.L1, view 1 (paper 2): configuration, commands, figures, and the page made of them."""
