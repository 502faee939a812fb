"""A safe consumer: `python consumer.py tcp/127.0.0.1:7447 SITE CAMERA ROI`, needs eclipse-zenoh alone.

Prints CLEAR, LUMP or SAFE with the reason when that changes; SAFE is what the plant does without eyes.
"""

import json
import sys
import time
from typing import Any

import zenoh

hub, site, camera, roi = sys.argv[1:]
root = f"lumpwatch/v1/{site}"
heard: dict[str, tuple[dict[str, Any], float]] = {}
alive: set[str] = set()
needed = {f"{root}/@alive/monitor/{camera}", f"{root}/@alive/daemon/{site}"}


def on_message(sample: zenoh.Sample) -> None:  # what came, and when by our own monotonic clock
    heard[str(sample.key_expr).rpartition("/")[2]] = json.loads(sample.payload.to_bytes()), time.monotonic()


def on_token(sample: zenoh.Sample) -> None:
    (alive.add if sample.kind == zenoh.SampleKind.PUT else alive.discard)(str(sample.key_expr))


def output() -> str:
    for what in ("heartbeat", "level"):
        message, at_s = heard.get(what, ({"valid_s": 0.0}, float("-inf")))
        if time.monotonic() - at_s > message["valid_s"]:
            return f"SAFE: no {what}" if what not in heard else f"SAFE: {what} expired"
    beat, level = heard["heartbeat"][0], heard["level"][0]
    if not needed <= alive:
        return "SAFE: liveliness token gone"
    if not beat["valid"] or not beat["rois"].get(roi, {}).get("valid"):
        return "SAFE: heartbeat says invalid"
    return "SAFE: blind" if level["blind"] else "LUMP" if level["lump"] else "CLEAR"


config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([hub]))
config.insert_json5("connect/timeout_ms", "-1")  # wait, in the safe state, for a daemon that is not there yet
shown = "SAFE: starting"
print(shown, flush=True)
with zenoh.open(config) as session:
    keys = f"{root}/{camera}/heartbeat", f"{root}/{camera}/{roi}/level"
    subscribers = [session.declare_subscriber(key, on_message) for key in keys]
    tokens = session.liveliness().declare_subscriber(f"{root}/@alive/**", on_token, history=True)
    while True:
        if (now := output()) != shown:
            print(shown := now, flush=True)
        time.sleep(0.05)
