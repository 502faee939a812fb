"""The detector of a ROI: picture in, objects and probability of existence out; one module a kind."""
