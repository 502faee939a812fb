"""The tests of lumpwatch."""
