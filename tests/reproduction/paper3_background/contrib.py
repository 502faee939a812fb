"""OpenCV's contrib subtractors in an interpreter of their own: `python contrib.py pictures.npy masks.npz THREADS`.

opencv-contrib-python and opencv-python cannot be installed together. $LUMPWATCH_CONTRIB_PYTHON names an
interpreter with opencv-contrib-python-headless and NumPy; this file imports nothing else.
"""

from __future__ import annotations

import importlib
import sys
import time
from typing import Any

import cv2
import numpy as np

METHODS = {"CNT": "CNT", "GSOC": "GSOC", "LSBP": "LSBP"}

if __name__ == "__main__":
    threads = int(sys.argv[3])
    cv2.setNumThreads(threads)
    clock = time.process_time if threads == 1 else time.perf_counter
    pictures = np.load(sys.argv[1])
    bgsegm = importlib.import_module("cv2.bgsegm")
    found: dict[str, Any] = {}
    for name in METHODS:
        subtractor = getattr(bgsegm, f"createBackgroundSubtractor{name}")()
        masks, seconds = [], []
        for picture in pictures:
            began = clock()
            mask = subtractor.apply(picture)
            seconds.append(clock() - began)
            masks.append(np.packbits(mask == 255))
        found[name] = np.array(masks)
        found[f"{name}_s"] = np.array(seconds)
    np.savez(sys.argv[2], **found)
