"""The hub of the bus as a process of its own, with its own memory: what others send there takes nothing else along."""

from lumpwatch.service.hub.hub_process import run_hub

__all__ = ["run_hub"]
