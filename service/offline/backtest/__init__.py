"""Backtests: configurations over an archive of labelled videos.

archive    videos and their labels
record     one configuration on one video: what the alarm judges and the estimates, frame by frame
truth      the labelled lumps of a video, and when an estimate lies on them
episodes   alarms at one threshold, and what they were worth
intervals  how uncertain a small count is
curve      all thresholds, and the one to recommend
run        everything together
report     the results as files
plots      the results as a picture
"""
