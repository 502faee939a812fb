"""Rolling the daemon out as a container. Only `engine` knows the container SDK; the daemon never imports this."""

from lumpwatch.service.deployment.bundling import Bundle, bundle
from lumpwatch.service.deployment.engine import DockerEngine, connect
from lumpwatch.service.deployment.errors import DeployError
from lumpwatch.service.deployment.plan import Found, Plan, short_name
from lumpwatch.service.deployment.rollout import Rollout

__all__ = [
    "Bundle",
    "DeployError",
    "DockerEngine",
    "Found",
    "Plan",
    "Rollout",
    "bundle",
    "connect",
    "short_name",
]
