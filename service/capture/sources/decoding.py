"""From packets to pictures, without any that a decoder has made up.

Decoders like to paint over damage: what is missing of a JPEG comes out as an old picture, and with that a lump that
fell long ago. All are told to refuse (`err_detect: explode`); the rest was tried with packets cut to half and with
bytes turned over. H.264, H.265, MPEG-4 and AV1 also refuse or mark what builds on a lost picture; codecs without
memory need not. Others go on from an old picture and say nothing: after damage they wait for the next key frame.
Bytes that were turned over go unnoticed in H.265, VP8 and raw pictures; a network loses bytes, it does not turn them
over. JPEG by RTP is put together by FFmpeg, which gives no picture where a packet of it was lost; one that the camera
itself cut is refused like any other.
"""

from __future__ import annotations

import av.error
from av import FFmpegError, VideoFrame
from av.packet import Packet
from av.video.stream import VideoStream

_MARK_WHAT_FOLLOWS = frozenset({"h264", "hevc", "mpeg4", "av1", "libdav1d", "libaom-av1"})
_REFUSES_WHOLE_ONES = frozenset({"tiff"})


def refusing(codec: str) -> dict[str, str]:
    """Options of a decoder that must not paint over damage; that of TIFF would refuse pictures that are whole."""
    return {} if codec in _REFUSES_WHOLE_ONES else {"err_detect": "explode"}


class PacketDecoder:
    """Decodes the packets of one stream."""

    def __init__(self, stream: VideoStream) -> None:
        codec = stream.codec_context.codec
        self._remembers = not (codec.intra_only or stream.codec_context.name in _MARK_WHAT_FOLLOWS)
        self._waits = False

    def decode(self, packet: Packet[VideoStream]) -> list[VideoFrame] | None:
        """The pictures that the packet completes; None where it is damaged, or builds on one that was."""
        if self._waits and packet.size and not packet.is_keyframe:
            return None
        self._waits = False
        try:
            return list(packet.decode())
        except av.error.EOFError:
            return []
        except FFmpegError:
            self._waits = self._remembers
            return None
