"""The network of a ROI: its file, read and tried before anything runs on it."""

from __future__ import annotations

import signal
import subprocess
import sys

import numpy as np

from lumpwatch.models.likelihood import NetworkLikelihood
from lumpwatch.models.likelihood.network import NetworkError, OnnxScoreMap
from lumpwatch.models.roi import View
from lumpwatch.service.config import NetworkConfig
from lumpwatch.service.errors import ConfigError

MAX_BYTES = 512 << 20
_TRIAL = (240, 320)


_LONGEST_TRIAL_S = 60.0
_TRIAL_MEMORY = 4 << 30
_CODE = """
import resource, sys
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
resource.setrlimit(resource.RLIMIT_DATA, (int(sys.argv[4]), int(sys.argv[4])))
import numpy as np
from lumpwatch.models.likelihood.network import NetworkError, OnnxScoreMap
width, height, channels = map(int, sys.argv[1:4])
try:
    OnnxScoreMap(sys.stdin.buffer.read(), (width, height), channels)(np.zeros((height, width), np.uint8))
except NetworkError:
    pass  # told in words by who asked
"""


def _try_apart(content: bytes, config: NetworkConfig, where: str) -> None:
    """Let another process look at it. Raises ConfigError."""
    width, height = config.input_px or (_TRIAL[1], _TRIAL[0])
    arguments = [str(one) for one in (width, height, config.channels, _TRIAL_MEMORY)]
    command = [sys.executable, "-c", _CODE, *arguments]
    try:
        done = subprocess.run(
            command, input=content, capture_output=True, timeout=_LONGEST_TRIAL_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise ConfigError(f"{where}: has not looked at one picture in {_LONGEST_TRIAL_S:.0f} s") from None
    except OSError as error:
        raise ConfigError(f"{where}: cannot be tried ({error.strerror})") from error
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        raise ConfigError(f"{where}: is damaged: reading it ends the process ({name})")
    if done.returncode:
        raise ConfigError(f"{where}: is damaged, or needs more than {_TRIAL_MEMORY >> 30} GiB")


def make_network(config: NetworkConfig, *, apart: bool = False) -> NetworkLikelihood:
    """The likelihood, after the network has looked at an empty picture.

    `apart`: another process looks first, for a damaged network may end the process that reads it. Raises ConfigError
    naming the file where it cannot be read, is no ONNX network, or gives no map.
    """
    where = f"likelihood kind network: {config.model}"
    try:
        if config.model.stat().st_size > MAX_BYTES:
            raise ConfigError(f"{where}: is larger than {MAX_BYTES >> 20} MiB")
        content = config.model.read_bytes()
    except OSError as error:
        raise ConfigError(f"{where}: cannot be read ({error.strerror})") from error
    if apart:
        _try_apart(content, config, where)
    width, height = config.input_px or (_TRIAL[1], _TRIAL[0])
    blank = View(np.zeros((height, width), np.uint8), None, np.zeros((height + 1, width + 1), np.int32))
    try:
        net = OnnxScoreMap(content, config.input_px, config.channels, config.scale)
        likelihood = NetworkLikelihood(net, config.threshold, config.evidence, config.bound)
        likelihood.observe(blank)
    except NetworkError as error:
        raise ConfigError(f"{where}: {error}") from error
    return likelihood
