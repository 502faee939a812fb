"""Plays an MP4 file over RTSP with GStreamer's server, once for each client: a real third party.

Runs under the system's Python, which has the GObject bindings; imports nothing of this project.

Usage: /usr/bin/python3 gst_server.py (h264|h265|mjpeg) VIDEO
       /usr/bin/python3 gst_server.py --check      exit code 1 where a part is missing
"""

import sys

import gi  # type: ignore[import-not-found]

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # type: ignore[import-not-found]  # noqa: E402

PAYLOADERS = {
    "h264": "h264parse ! rtph264pay config-interval=-1",
    "h265": "h265parse ! rtph265pay config-interval=-1",
    "mjpeg": "jpegdec ! jpegenc ! rtpjpegpay",
}


def missing() -> list[str]:
    """Elements that the pipelines need and that are not installed."""
    parts = {word for line in PAYLOADERS.values() for word in line.split() if word.isalnum()}
    return sorted(part for part in parts | {"qtdemux"} if Gst.ElementFactory.find(part) is None)


def main() -> None:
    """Serve until killed."""
    Gst.init(None)
    if sys.argv[1] == "--check":
        if missing():
            sys.exit("GStreamer elements missing: " + ", ".join(missing()))
        return
    codec, video = sys.argv[1:]
    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch(f'( filesrc location="{video}" ! qtdemux ! {PAYLOADERS[codec]} name=pay0 )')
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service("0")
    server.get_mount_points().add_factory("/cam", factory)
    server.attach(None)
    print(f"rtsp://127.0.0.1:{server.get_bound_port()}/cam", flush=True)
    GLib.MainLoop().run()


main()
