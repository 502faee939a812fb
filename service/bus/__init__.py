"""The bus: transport only. Keys, codecs and sessions; no other package imports zenoh."""

from lumpwatch.service.bus.access import Role
from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.codec import FrameHeader
from lumpwatch.service.bus.cut_off import Burden, CutOff
from lumpwatch.service.bus.endpoints import Callback, Handler, Publisher
from lumpwatch.service.bus.errors import BusClosed, BusError
from lumpwatch.service.bus.frames import SHARED_MEMORY_MIB, FrameInbox
from lumpwatch.service.bus.handles import Handle
from lumpwatch.service.bus.keys import KEY_OF, Keys, Kind, command_key
from lumpwatch.service.bus.ordering import Message
from lumpwatch.service.bus.services import Service
from lumpwatch.service.bus.session import host_clock, open_client, open_hub, reachable, with_ports

__all__ = [
    "KEY_OF",
    "SHARED_MEMORY_MIB",
    "Burden",
    "Bus",
    "BusClosed",
    "BusError",
    "Callback",
    "CutOff",
    "FrameHeader",
    "FrameInbox",
    "Handle",
    "Handler",
    "Keys",
    "Kind",
    "Message",
    "Publisher",
    "Role",
    "Service",
    "command_key",
    "host_clock",
    "open_client",
    "open_hub",
    "reachable",
    "with_ports",
]
