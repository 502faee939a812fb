"""Feeds made of real pixels, and what the product finds on them by its command line.

ore       the pictures of belt-ore, split by frame and joined to the frames they were cut from
strip     ore without end: windows of frames joined along seams that go around rocks
stones    rocks cut out along their outlines and laid on a strip
view      a camera over the belt; calibration
render    a strip that scrolls under a camera, with light, dust, noise and shake, as video and labels
feeds     which feeds there are, and how each is made
cctv      real belts from a plant's own cameras, as they are and with lumps laid on them
judge     announced in time, false alarms, from the files that `lumpwatch replay` writes
runner    trains and replays by the command line; peers: the simple methods on the same feeds
page      the page of results; suite: all of it, for `make reproduce`
"""
