"""The network of a ROI: its file, read and tried before anything runs on it."""

from __future__ import annotations

import numpy as np

from lumpwatch.models.likelihood import NetworkLikelihood
from lumpwatch.models.likelihood.network import NetworkError, OnnxScoreMap
from lumpwatch.models.roi import View
from lumpwatch.service.config import NetworkConfig
from lumpwatch.service.errors import ConfigError

MAX_BYTES = 512 << 20
_TRIAL = (240, 320)


def make_network(config: NetworkConfig) -> NetworkLikelihood:
    """The likelihood, after the network has looked at an empty picture.

    Raises ConfigError naming the file where it cannot be read, is no ONNX network, or gives no map.
    """
    where = f"likelihood kind network: {config.model}"
    try:
        if config.model.stat().st_size > MAX_BYTES:
            raise ConfigError(f"{where}: is larger than {MAX_BYTES >> 20} MiB")
        content = config.model.read_bytes()
    except OSError as error:
        raise ConfigError(f"{where}: cannot be read ({error.strerror})") from error
    width, height = config.input_px or (_TRIAL[1], _TRIAL[0])
    blank = View(np.zeros((height, width), np.uint8), None, np.zeros((height + 1, width + 1), np.int32))
    try:
        net = OnnxScoreMap(content, config.input_px, config.channels, config.scale)
        likelihood = NetworkLikelihood(net, config.threshold, config.evidence, config.bound)
        likelihood.observe(blank)
    except NetworkError as error:
        raise ConfigError(f"{where}: {error}") from error
    return likelihood
