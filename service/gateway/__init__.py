"""The gateway to the plant's control system: values and signals by its protocols, in a process of its own."""

from lumpwatch.service.gateway.errors import GatewayError
from lumpwatch.service.gateway.map_text import as_csv, as_json, as_table
from lumpwatch.service.gateway.process import Served, run_gateway
from lumpwatch.service.gateway.register_map import RegisterMap

__all__ = ["GatewayError", "RegisterMap", "Served", "as_csv", "as_json", "as_table", "run_gateway"]
